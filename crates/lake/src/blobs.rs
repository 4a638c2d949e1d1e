//! Bytes by their digest.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use dataflow::{Digest, FileRef};

use crate::{
    LakeError,
    atomic::{io_error, rename},
};

/// The folder of blobs.
pub(crate) struct Blobs {
    root: PathBuf,
}

impl Blobs {
    pub(crate) fn new(root: PathBuf) -> Self {
        Self { root }
    }

    /// Where the bytes of a digest lie.
    pub(crate) fn path(&self, digest: &Digest) -> PathBuf {
        let name = digest.as_str();
        self.root.join(name.get(..2).unwrap_or_default()).join(name)
    }

    /// Moves a file into the folder under its digest. The file must lie on the same file system.
    pub(crate) fn take(&self, file: &Path) -> Result<FileRef, LakeError> {
        let digest = digest_file(file).map_err(io_error("read", file))?;
        let metadata = File::open(file)
            .and_then(|file| {
                file.sync_all()?;
                file.metadata()
            })
            .map_err(io_error("write", file))?;
        let path = self.path(&digest);
        // Bytes that are there already are replaced all the same: they may be damaged.
        let mut permissions = metadata.permissions();
        permissions.set_readonly(true);
        fs::set_permissions(file, permissions).map_err(io_error("write", file))?;
        rename(file, &path)?;
        Ok(FileRef {
            digest,
            size: metadata.len(),
        })
    }

    /// Whether a file is there with the right size.
    pub(crate) fn has(&self, file: &FileRef) -> bool {
        fs::metadata(self.path(&file.digest)).is_ok_and(|metadata| metadata.len() == file.size)
    }

    /// Whether a file's bytes are the ones that its name promises.
    pub(crate) fn is_whole(&self, file: &FileRef) -> Result<bool, LakeError> {
        let path = self.path(&file.digest);
        match digest_file(&path) {
            Ok(digest) => Ok(digest == file.digest),
            Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(err) => Err(io_error("read", &path)(err)),
        }
    }

    /// Removes a damaged file.
    pub(crate) fn drop(&self, file: &FileRef) -> Result<(), LakeError> {
        let path = self.path(&file.digest);
        match fs::remove_file(&path) {
            Err(err) if err.kind() != io::ErrorKind::NotFound => {
                Err(io_error("remove", &path)(err))
            }
            _ => Ok(()),
        }
    }
}

/// Digests a file without holding it in memory.
pub(crate) fn digest_file(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Digest::try_from(hasher.finalize().to_hex().to_string()).map_err(io::Error::other)
}
