//! Digests of files outside the lake, remembered as long as size, time and inode stay the same.

use std::{
    collections::BTreeMap,
    fs, io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Duration,
};

use dataflow::Digest;
use serde::{Deserialize, Serialize};

use crate::{LakeError, atomic, blobs::digest_file, clock::now};

/// A file that changed less than this before it was digested may change again within the same tick
/// of its clock, so its digest is not remembered.
const SETTLED: Duration = Duration::from_secs(2);

/// The remembered digests.
pub(crate) struct Sources {
    file: PathBuf,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    entries: BTreeMap<PathBuf, Entry>,
    changed: bool,
}

#[derive(Clone, Serialize, Deserialize)]
struct Entry {
    stamp: Stamp,
    digest: Digest,
}

#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Stamp {
    size: u64,
    modified_s: i64,
    modified_ns: i64,
    inode: u64,
}

impl Sources {
    /// Reads what was remembered; a file that cannot be read only costs time.
    pub(crate) fn open(file: PathBuf) -> Self {
        let entries = fs::read(&file)
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .unwrap_or_default();
        Self {
            file,
            known: Mutex::new(Known {
                entries,
                changed: false,
            }),
        }
    }

    pub(crate) fn digest(&self, path: &Path) -> io::Result<Digest> {
        let metadata = fs::metadata(path)?;
        let stamp = Stamp {
            size: metadata.size(),
            modified_s: metadata.mtime(),
            modified_ns: metadata.mtime_nsec(),
            inode: metadata.ino(),
        };
        let absolute = std::path::absolute(path)?;
        let lock = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(entry) = lock().entries.get(&absolute)
            && entry.stamp == stamp
        {
            return Ok(entry.digest.clone());
        }
        let digest = digest_file(path)?;
        let settled = metadata
            .modified()
            .ok()
            .and_then(|modified| now().duration_since(modified).ok())
            .is_some_and(|age| age > SETTLED);
        if settled {
            let mut known = lock();
            let entry = Entry {
                stamp,
                digest: digest.clone(),
            };
            known.entries.insert(absolute, entry);
            known.changed = true;
        }
        Ok(digest)
    }

    /// Keeps what was learned.
    pub(crate) fn save(&self, staging: &Path) -> Result<(), LakeError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.changed {
            let bytes = serde_json::to_vec(&known.entries).map_err(|source| LakeError::Json {
                path: self.file.clone(),
                source,
            })?;
            atomic::write(staging, &self.file, &bytes)?;
            known.changed = false;
        }
        Ok(())
    }
}
