//! Fetching blobs, checked while they come.

use std::{
    fs::{self, File},
    io::{self, Seek, Write},
    path::Path,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use ::clock::lock;
use dataflow::{Digest, FileRef};
use depot::Piece;

use super::{Shared, keys};
use crate::{
    LakeError,
    atomic::{self, io_error},
    blobs::Blobs,
};

/// Blobs fetched at once.
const AT_ONCE: usize = 8;

/// Times that bytes which came damaged are asked for.
const TRIES: usize = 2;

/// Outcome of fetching a blob.
enum FetchOutcome {
    Whole,
    Damaged,
    Nothing,
}

impl Shared {
    /// Fetches the blobs that are not here, as far as the depot has them whole.
    pub(crate) fn fetch_all<'f>(
        &self,
        blobs: &Blobs,
        files: impl IntoIterator<Item = &'f FileRef>,
    ) -> Result<(), LakeError> {
        let files = files.into_iter();
        let absent: Vec<&FileRef> = files
            .filter(|file| !blobs.path(&file.digest).exists())
            .collect();
        let next = AtomicUsize::new(0);
        let failed = Mutex::new(None);
        ::clock::all(absent.len().min(AT_ONCE), || {
            while let Some(file) = absent.get(next.fetch_add(1, Ordering::Relaxed)) {
                if let Err(err) = self.fetch(blobs, file) {
                    lock(&failed).get_or_insert(err);
                    return;
                }
            }
        });
        let failed = lock(&failed).take();
        failed.map_or(Ok(()), Err)
    }

    /// Fetches a blob; returns whether it is here whole now.
    pub(crate) fn fetch(&self, blobs: &Blobs, file: &FileRef) -> Result<bool, LakeError> {
        let digest = &file.digest;
        if lock(&self.lost).contains(digest) {
            return Ok(false);
        }
        let staging = self.folder.staging();
        fs::create_dir_all(&staging).map_err(io_error("create", &staging))?;
        for _ in 0..TRIES {
            let beside = atomic::temporary_name(&staging);
            let came = self.download(file, &beside);
            // A depot that is offline may still have it.
            if let Err(LakeError::Depot(_)) = came {
                let _gone = fs::remove_file(&beside);
                return self.or_alone(came.map(|_| false));
            }
            if let Ok(FetchOutcome::Whole) = came {
                blobs.take_fetched(&beside, digest)?;
                self.unfetched.remove(digest);
                self.n_fetched.fetch_add(1, Ordering::Relaxed);
                return Ok(true);
            }
            let _gone = fs::remove_file(&beside);
            match came? {
                FetchOutcome::Damaged => {
                    lock(&self.damaged).insert(*digest);
                }
                FetchOutcome::Whole | FetchOutcome::Nothing => break,
            }
        }
        lock(&self.lost).insert(*digest);
        self.unfetched.remove(digest);
        Ok(false)
    }

    /// Writes a blob's bytes to a file, synced.
    fn download(&self, file: &FileRef, beside: &Path) -> Result<FetchOutcome, LakeError> {
        let mut to = File::create_new(beside).map_err(io_error("write", beside))?;
        let mut hasher = blake3::Hasher::new();
        let mut left = file.size;
        let (mut written, mut is_too_long) = (Ok(()), false);
        let link = self.remote.link()?;
        let got = link.get(&keys::blob(&file.digest), &mut |piece| {
            written = match piece {
                Piece::Begin => {
                    hasher.reset();
                    left = file.size;
                    to.rewind().and_then(|()| to.set_len(0))
                }
                Piece::Bytes(bytes) => {
                    hasher.update(bytes);
                    let rest = left.checked_sub(bytes.len() as u64);
                    is_too_long = rest.is_none();
                    left = rest.ok_or_else(|| io::Error::other("too long"))?;
                    to.write_all(bytes)
                }
            };
            let is_written = written.is_ok();
            is_written
                .then_some(())
                .ok_or_else(|| io::Error::other("cannot be kept"))
        });
        written.map_err(io_error("write", beside))?;
        if is_too_long {
            return Ok(FetchOutcome::Damaged);
        }
        let is_whole = || left == 0 && Digest::from(*hasher.finalize().as_bytes()) == file.digest;
        match got? {
            false => Ok(FetchOutcome::Nothing),
            true if is_whole() => {
                to.sync_all().map_err(io_error("write", beside))?;
                Ok(FetchOutcome::Whole)
            }
            true => Ok(FetchOutcome::Damaged),
        }
    }
}
