//! Bytes by their digest.

use std::{
    collections::{BTreeSet, HashMap},
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use dataflow::{Digest, FileRef};

use crate::{
    LakeError,
    atomic::{self, io_error, rename},
    clock::now,
    stamp::Stamp,
};

/// The folder of blobs.
pub(crate) struct Blobs {
    root: PathBuf,
    stamps: Mutex<Stamps>,
}

/// What is known about blobs without reading them.
#[derive(Default)]
struct Stamps {
    /// Stamps that blobs had when their bytes were last seen to be right.
    whole: HashMap<Digest, Stamp>,
    /// Blobs whose stamps this process itself moves on, by linking and unlinking them.
    touched: BTreeSet<Digest>,
    changed: bool,
}

impl Blobs {
    pub(crate) fn new(root: PathBuf) -> Self {
        Self {
            root,
            stamps: Mutex::default(),
        }
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Where the bytes of a digest lie.
    pub(crate) fn path(&self, digest: &Digest) -> PathBuf {
        let name = digest.to_hex();
        self.root.join(name.get(..2).unwrap_or_default()).join(name)
    }

    fn stamps(&self) -> MutexGuard<'_, Stamps> {
        self.stamps.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Recalls stamps that another process saw on whole blobs.
    pub(crate) fn recall(&self, stamps: impl IntoIterator<Item = (Digest, Stamp)>) {
        self.stamps().whole.extend(stamps);
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
            // Bytes that are there already are used again: the newer time keeps them.
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
            let mut permissions = metadata.permissions();
            permissions.set_readonly(true);
            fs::set_permissions(file, permissions).map_err(io_error("write", file))?;
            rename(file, &self.path(&digest))?;
        }
        self.remember(&digest)?;
        Ok(kept)
    }

    /// Whether a file's bytes are the ones that its name promises. They are read only if the file's
    /// stamp is not the one that it had when they were last seen to be right.
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
        if self.stamps().whole.get(&file.digest) == Some(&stamp) {
            return Ok(true);
        }
        let is_whole = self.is_whole(file)?;
        if is_whole {
            self.remember(&file.digest)?;
        }
        Ok(is_whole)
    }

    /// Whether a file's bytes are the ones that its name promises, by reading them.
    pub(crate) fn is_whole(&self, file: &FileRef) -> Result<bool, LakeError> {
        let path = self.path(&file.digest);
        match digest_file(&path) {
            Ok(digest) => Ok(digest == file.digest),
            Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(err) => Err(io_error("read", &path)(err)),
        }
    }

    /// Puts a lost or damaged blob back from where its bytes are shown.
    pub(crate) fn put_back(
        &self,
        shown: &Path,
        file: &FileRef,
        staging: &Path,
    ) -> Result<(), LakeError> {
        let path = self.path(&file.digest);
        let beside = atomic::temporary_name(staging);
        let put = fs::hard_link(shown, &beside)
            .or_else(|_no_links| fs::copy(shown, &beside).map(drop))
            .map_err(io_error("copy", shown))
            .and_then(|()| rename(&beside, &path));
        if put.is_err() {
            let _gone = fs::remove_file(&beside);
        }
        put
    }

    /// Removes a damaged file, unless somebody has made it again meanwhile.
    pub(crate) fn drop(&self, file: &FileRef) -> Result<(), LakeError> {
        self.stamps().whole.remove(&file.digest);
        if self.is_whole(file)? {
            return Ok(());
        }
        let path = self.path(&file.digest);
        match fs::remove_file(&path) {
            Err(err) if err.kind() != io::ErrorKind::NotFound => {
                Err(io_error("remove", &path)(err))
            }
            _ => Ok(()),
        }
    }

    /// Remembers the stamp of a blob whose bytes are right.
    fn remember(&self, digest: &Digest) -> Result<(), LakeError> {
        let path = self.path(digest);
        let stamp = Stamp::read(&path).map_err(io_error("read", &path))?;
        let mut stamps = self.stamps();
        stamps.changed |= stamps.whole.insert(*digest, stamp) != Some(stamp);
        Ok(())
    }

    /// Says that this process has linked or unlinked a blob, which moves its stamp.
    pub(crate) fn touch(&self, digest: &Digest) {
        self.stamps().touched.insert(*digest);
    }

    /// Takes the stamps of blobs that this process has linked or unlinked anew, and returns those
    /// blobs.
    pub(crate) fn settle(&self) -> BTreeSet<Digest> {
        let mut stamps = self.stamps();
        let touched = std::mem::take(&mut stamps.touched);
        for digest in &touched {
            if let Some(&before) = stamps.whole.get(digest) {
                match Stamp::read(&self.path(digest)) {
                    // What else has moved was somebody else's doing: the bytes are read next time.
                    Ok(stamp) if stamp.differs_by_links_alone(before) => {
                        stamps.whole.insert(*digest, stamp)
                    }
                    _ => stamps.whole.remove(digest),
                };
            }
        }
        stamps.changed |= !touched.is_empty();
        touched
    }

    /// Whether stamps were learned since they were recalled.
    pub(crate) fn learned(&self) -> bool {
        let stamps = self.stamps();
        stamps.changed || !stamps.touched.is_empty()
    }

    /// The stamp that a blob had when its bytes were last seen to be right.
    pub(crate) fn stamp(&self, digest: &Digest) -> Option<Stamp> {
        self.stamps().whole.get(digest).copied()
    }
}

/// Digests a file without holding it in memory.
pub(crate) fn digest_file(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(Digest::from(*hasher.finalize().as_bytes()))
}
