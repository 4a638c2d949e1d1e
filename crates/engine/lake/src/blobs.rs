//! Bytes by their digest.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::Mutex,
};

use ::clock::lock;
use dataflow::{Digest, FileRef, Stamp};

use crate::{
    LakeError,
    atomic::{self, io_error, rename},
    clock::now,
    digests::digest_file,
    folder::Folder,
    stamps::Stamps,
};

/// The folder of blobs.
pub(crate) struct Blobs {
    folder: Folder,
    /// Stamps of whole blobs.
    pub(crate) stamps: Stamps,
    /// Blobs whose stamps this process itself changes, by linking and unlinking them.
    touched: Mutex<BTreeSet<Digest>>,
}

impl Blobs {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            stamps: Stamps::default(),
            touched: Mutex::default(),
        }
    }

    /// Path of the blob with this digest.
    pub(crate) fn path(&self, digest: &Digest) -> PathBuf {
        let name = digest.to_hex();
        let folder = self.folder.blobs().join(name.get(..2).unwrap_or_default());
        folder.join(name)
    }

    /// Moves a file into the folder under its digest.
    pub(crate) fn take(&self, file: &Path) -> Result<FileRef, LakeError> {
        let digest = digest_file(file).map_err(io_error("read", file))?;
        let metadata = fs::metadata(file).map_err(io_error("read", file))?;
        let kept = FileRef {
            digest,
            size: metadata.len(),
        };
        if self.is_whole(&kept)? {
            // Existing bytes are reused: their newer time protects them from collection.
            let path = self.path(&digest);
            File::open(&path)
                .and_then(|blob| blob.set_modified(now()))
                .map_err(io_error("write", &path))?;
            self.touch(&digest);
            fs::remove_file(file).map_err(io_error("remove", file))?;
        } else {
            File::open(file)
                .and_then(|file| file.sync_all())
                .map_err(io_error("write", file))?;
            self.take_fetched(file, &digest)?;
            return Ok(kept);
        }
        self.remember(&digest)?;
        Ok(kept)
    }

    /// Moves a file, whose bytes were just checked and synced, into the folder under their digest.
    pub(crate) fn take_fetched(&self, file: &Path, digest: &Digest) -> Result<(), LakeError> {
        let metadata = fs::metadata(file).map_err(io_error("read", file))?;
        let mut permissions = metadata.permissions();
        permissions.set_readonly(true);
        fs::set_permissions(file, permissions).map_err(io_error("write", file))?;
        rename(file, &self.path(digest))?;
        self.remember(digest)
    }

    /// Whether a file's bytes match its name. They are read only if the file's stamp has changed
    /// since they were last verified.
    pub(crate) fn is_unchanged(&self, file: &FileRef) -> Result<bool, LakeError> {
        let path = self.path(&file.digest);
        let stamp = match Stamp::read(&path) {
            Ok(stamp) => stamp,
            Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(false),
            Err(err) => return Err(io_error("read", &path)(err)),
        };
        if stamp.size() != file.size {
            return Ok(false);
        }
        if self.stamps.get(&file.digest) == Some(stamp) {
            return Ok(true);
        }
        let is_whole = self.is_whole(file)?;
        if is_whole {
            self.remember(&file.digest)?;
        }
        Ok(is_whole)
    }

    /// Whether a file's bytes match its name, by reading them.
    pub(crate) fn is_whole(&self, file: &FileRef) -> Result<bool, LakeError> {
        let path = self.path(&file.digest);
        match digest_file(&path) {
            Ok(digest) => Ok(digest == file.digest),
            Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(err) => Err(io_error("read", &path)(err)),
        }
    }

    /// Restores a missing or damaged blob from its published file.
    pub(crate) fn put_back(&self, published: &Path, file: &FileRef) -> Result<(), LakeError> {
        atomic::place(&self.folder.staging(), &self.path(&file.digest), |beside| {
            fs::hard_link(published, beside)
                .or_else(|_no_links| fs::copy(published, beside).map(drop))
                .map_err(io_error("copy", published))
        })
    }

    /// Removes a damaged file, unless another process has rebuilt it meanwhile.
    pub(crate) fn drop(&self, file: &FileRef) -> Result<(), LakeError> {
        self.stamps.forget(&file.digest);
        if self.is_whole(file)? {
            return Ok(());
        }
        atomic::remove_if_there(&self.path(&file.digest))
    }

    /// Records the stamp of a verified blob.
    fn remember(&self, digest: &Digest) -> Result<(), LakeError> {
        let path = self.path(digest);
        let stamp = Stamp::read(&path).map_err(io_error("read", &path))?;
        self.stamps.learn(digest, stamp);
        Ok(())
    }

    /// Notes that this process has linked or unlinked a blob, which changes its stamp.
    pub(crate) fn touch(&self, digest: &Digest) {
        lock(&self.touched).insert(*digest);
    }

    /// Refreshes the stamps of blobs that this process has linked or unlinked, and returns those
    /// blobs.
    pub(crate) fn settle(&self) -> BTreeSet<Digest> {
        let touched = std::mem::take(&mut *lock(&self.touched));
        for digest in &touched {
            if let Some(before) = self.stamps.get(digest) {
                match Stamp::read(&self.path(digest)) {
                    // Any other change came from another process: the bytes are read next time.
                    Ok(stamp) if stamp.differs_by_links_alone(before) => {
                        self.stamps.learn(digest, stamp);
                    }
                    _ => self.stamps.forget(digest),
                }
            }
        }
        touched
    }

    /// Whether stamps were learned since they were recalled.
    pub(crate) fn learned(&self) -> bool {
        self.stamps.learned() || !lock(&self.touched).is_empty()
    }
}
