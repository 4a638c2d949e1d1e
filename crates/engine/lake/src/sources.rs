//! Digests of files outside the lake, cached while their stamps are unchanged.

use std::{
    collections::{BTreeMap, HashMap},
    env, io,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, OnceLock},
};

use ::clock::lock;
use dataflow::{Digest, Stamp};

use crate::{
    LakeError, atomic,
    clock::now,
    codec::{Reader, Writer},
    digests::digest_file,
    folder::Folder,
    lock::Locks,
};

/// The file's format, which tells it from other caches.
const FORMAT: &str = "sources";
const VERSION: u64 = 1;

/// The cached digests.
pub(crate) struct Sources {
    folder: Folder,
    known: OnceLock<Mutex<SourceCache>>,
    /// The base of relative paths.
    here: OnceLock<PathBuf>,
}

#[derive(Default)]
pub(crate) struct SourceCache {
    /// By absolute path.
    pub(crate) entries: HashMap<String, Entry>,
    /// Changes by this process: new entries, or `None` for removed ones.
    learned: BTreeMap<String, Option<Entry>>,
}

/// The cached stamp and digest of a file.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) stamp: Stamp,
    pub(crate) digest: Digest,
}

impl Sources {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            known: OnceLock::new(),
            here: OnceLock::new(),
        }
    }

    /// The cache, read on first use; an unusable cache file only costs time.
    pub(crate) fn known(&self) -> MutexGuard<'_, SourceCache> {
        let known = self.known.get_or_init(|| {
            let bytes = atomic::read_if_there(&self.folder.sources());
            let bytes = bytes.ok().flatten().unwrap_or_default();
            Mutex::new(SourceCache {
                entries: parse(&bytes).unwrap_or_default(),
                learned: BTreeMap::new(),
            })
        });
        lock(known)
    }

    /// Returns the digest of a file's content, from the cache while the stamp is that of the cached one. The stamp
    /// is read unless somebody has just done so.
    pub(crate) fn digest(&self, path: &Path, stamp: Option<Stamp>) -> io::Result<Digest> {
        let stamp = stamp.map_or_else(|| Stamp::read(path), Ok)?;
        let key = self.key(path);
        if let Some(key) = &key
            && let Some(entry) = self.known().entries.get(key)
            && entry.stamp == stamp
        {
            return Ok(entry.digest);
        }
        let asked = now();
        let digest = digest_file(path)?;
        // A file that was written a moment ago, or while it was read, is read again next time.
        if let Some(key) = key
            && stamp.is_settled(asked)
            && Stamp::read(path)? == stamp
        {
            let mut known = self.known();
            let entry = Entry { stamp, digest };
            known.learned.insert(key.clone(), Some(entry));
            known.entries.insert(key, entry);
        }
        Ok(digest)
    }

    /// The absolute path of a file, its cache key; `None` if it is not UTF-8.
    fn key(&self, path: &Path) -> Option<String> {
        if path.is_absolute() {
            return path.to_str().map(str::to_owned);
        }
        let here = self
            .here
            .get_or_init(|| env::current_dir().unwrap_or_default());
        here.join(path).into_os_string().into_string().ok()
    }

    /// Removes a file from the cache, so that it is read the next time.
    pub(crate) fn forget(&self, path: &str) {
        let mut known = self.known();
        if known.entries.remove(path).is_some() {
            known.learned.insert(path.to_owned(), None);
        }
    }

    /// Saves the changes, merged with those that other processes saved meanwhile.
    pub(crate) fn save(&self, locks: &Locks) -> Result<(), LakeError> {
        let mut known = self.known();
        if known.learned.is_empty() {
            return Ok(());
        }
        let _turn = locks.lock_sources()?;
        let file = self.folder.sources();
        let there = atomic::read_if_there(&file)?.unwrap_or_default();
        // The file has these entries too: nothing of a large dataset is held twice.
        known.entries = HashMap::new();
        let mut entries = parse(&there).unwrap_or_default();
        drop(there);
        for (path, entry) in std::mem::take(&mut known.learned) {
            match entry {
                Some(entry) => entries.insert(path, entry),
                None => entries.remove(&path),
            };
        }
        let sorted: BTreeMap<&String, &Entry> = entries.iter().collect();
        let mut writer = Writer::new(VERSION);
        writer.text(FORMAT);
        writer.number(sorted.len() as u64);
        for (path, entry) in sorted {
            writer.text(path);
            writer.stamp(entry.stamp);
            writer.digest(&entry.digest);
        }
        writer.write(&self.folder, &file)?;
        known.entries = entries;
        Ok(())
    }
}

/// Whether bytes are an intact cache.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    parse(bytes).is_some()
}

/// Parses the file; `None` if it is damaged, or of another format or version.
fn parse(bytes: &[u8]) -> Option<HashMap<String, Entry>> {
    let mut reader = Reader::of(bytes, VERSION)?;
    if reader.text()? != FORMAT {
        return None;
    }
    reader.each(|reader| {
        let path = reader.text()?.to_owned();
        let stamp = reader.stamp()?;
        let digest = reader.digest()?;
        Some((path, Entry { stamp, digest }))
    })
}

#[cfg(test)]
mod tests {
    use std::{fs::File, time::Duration};

    use super::*;

    /// Waits until the file's times are so old that a later write would show in them.
    fn settle(path: &Path) {
        while !Stamp::read(path).unwrap().is_settled(now()) {
            std::thread::yield_now();
        }
    }

    /// A writable lake folder, with its locks.
    fn lake(folder: &Path) -> (Folder, Locks) {
        let folder = Folder::new(folder);
        std::fs::create_dir(folder.staging()).unwrap();
        let locks = Locks::new(folder.locks());
        (folder, locks)
    }

    #[test]
    fn a_touched_file_is_read_once_and_not_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording");
        File::create(&path).unwrap();
        let (lake, locks) = lake(folder.path());
        let sources = Sources::new(lake.clone());
        settle(&path);
        let empty = Digest::of_bytes(b"");
        assert_eq!(sources.digest(&path, None).unwrap(), empty);

        let long_ago = now() - Duration::from_secs(1000);
        File::open(&path).unwrap().set_modified(long_ago).unwrap();
        settle(&path);
        assert_eq!(sources.digest(&path, None).unwrap(), empty);
        // The cached digest is trusted without reading the bytes, also by the next process.
        let key = path.to_str().unwrap();
        let stamp = Stamp::read(&path).unwrap();
        assert_eq!(sources.known().entries[key].stamp, stamp);
        let sentinel = Digest::of_bytes(b"not what is in the file");
        sources
            .known()
            .learned
            .get_mut(key)
            .unwrap()
            .as_mut()
            .unwrap()
            .digest = sentinel;
        sources.save(&locks).unwrap();
        let next = Sources::new(lake);
        assert_eq!(next.digest(&path, None).unwrap(), sentinel);
    }

    #[test]
    fn digests_cached_by_another_process_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (lake, locks) = lake(folder.path());
        let (one, other) = (Sources::new(lake.clone()), Sources::new(lake.clone()));
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        for path in &paths {
            File::create(path).unwrap();
            settle(path);
        }
        one.digest(&paths[0], None).unwrap();
        other.digest(&paths[1], None).unwrap();
        one.save(&locks).unwrap();
        other.save(&locks).unwrap();
        assert_eq!(Sources::new(lake).known().entries.len(), 2);
    }
}
