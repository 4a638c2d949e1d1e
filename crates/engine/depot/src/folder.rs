//! A depot in a folder that machines share: NFS, Lustre, sshfs, or a disk.
//!
//! It takes no locks, which on such folders often hold on one machine only. A file is written beside,
//! synced, and then linked to its name, which one of several machines does: `link` is atomic on the
//! server.

use std::{
    fs::{self, File},
    io::{self, Read, Write},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    process,
    sync::{
        LazyLock, OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

use crate::{
    DepotError,
    interface::{Content, Depot, Entry, Put, PutMode, Sink},
};

/// Prefix of the keys of files that are being written to a folder; `gc` finds what died with its writer there.
pub const WRITING: &str = "writing";

/// Bytes read and passed on at a time.
const PIECE: usize = 256 * 1024;

/// Makes the names of one process's files unique.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Tells apart processes with one number on several machines.
static MACHINE: LazyLock<String> = LazyLock::new(|| {
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    format!("{}-{}", host.trim(), boot.trim())
});

/// A depot in a folder.
pub struct FolderDepot {
    root: PathBuf,
    /// A name in the folder that stays: that of a folder of files, or of a file.
    known: OnceLock<PathBuf>,
}

impl FolderDepot {
    /// Returns the depot in a folder, which must exist: a folder that is not mounted is no empty
    /// depot.
    pub fn new(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            known: OnceLock::new(),
        }
    }

    fn path(&self, key: &str) -> PathBuf {
        self.root.join(key)
    }

    /// Makes a system's error that of a request; it is the folder's where that is away.
    fn failed(&self, action: &'static str, key: &str, err: io::Error) -> DepotError {
        match self.check() {
            Ok(()) => DepotError::io(action, key)(err),
            Err(source) => DepotError::Folder {
                folder: self.root.display().to_string(),
                source,
            },
        }
    }

    /// Checks that the folder is there; where a name in it is gone that stays, its file system is not mounted.
    fn check(&self) -> io::Result<()> {
        if !fs::metadata(&self.root)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        if let Some(known) = self.known.get()
            && if_there(fs::symlink_metadata(known))?.is_none()
        {
            let what = format!("`{}` was there before", known.display());
            return Err(io::Error::new(io::ErrorKind::NotFound, what));
        }
        Ok(())
    }

    /// Notes that there is a file of this key.
    fn know(&self, key: &str) {
        self.known.get_or_init(|| {
            let first = key.split('/').next().unwrap_or_default();
            self.root.join(first)
        });
    }

    /// Checks that no folder of a key is a link, which would lead out of the depot. A person may have put
    /// the first, such as `blobs`, on another disk.
    fn check_below(&self, key: &str) -> io::Result<()> {
        let folders = Path::new(key).ancestors().skip(1);
        for folder in folders.filter(|folder| folder.iter().count() > 1) {
            if fs::symlink_metadata(self.root.join(folder))?.is_symlink() {
                let what = format!("`{}` of the depot is a link", folder.display());
                return Err(io::Error::new(io::ErrorKind::NotADirectory, what));
            }
        }
        Ok(())
    }

    /// Makes the folders above a path below the depot's own: one that has just gone away is not made anew in its
    /// place.
    fn make_parent(&self, path: &Path) -> io::Result<()> {
        let Some(folder) = path.parent().filter(|folder| *folder != self.root) else {
            return Ok(());
        };
        let create = || match fs::create_dir(folder) {
            Err(err) if err.kind() == io::ErrorKind::AlreadyExists => Ok(()),
            created => created,
        };
        let created = create();
        let lacks_parent = |err: &io::Error| err.kind() == io::ErrorKind::NotFound;
        if created.as_ref().is_err_and(lacks_parent) && fs::metadata(&self.root).is_ok() {
            self.make_parent(folder)?;
            return create();
        }
        created
    }

    /// Writes content beside its final name, synced.
    fn write(&self, content: Content) -> io::Result<PathBuf> {
        self.check()?;
        // A process of the same name may have left a file behind.
        let (beside, file) = loop {
            let number = COUNTER.fetch_add(1, Ordering::Relaxed);
            let name = format!("{}-{}-{number}", *MACHINE, process::id());
            let beside = self.path(WRITING).join(name);
            self.make_parent(&beside)?;
            match File::create_new(&beside) {
                Err(err) if err.kind() == io::ErrorKind::AlreadyExists => {}
                created => break (beside, created?),
            }
        };
        let written = write_synced(file, content);
        if written.is_err() {
            let _gone = fs::remove_file(&beside);
        }
        written.map(|()| beside)
    }

    fn place(&self, key: &str, content: Content, mode: PutMode) -> io::Result<Put> {
        let beside = self.write(content)?;
        let path = self.path(key);
        let placed = self
            .make_parent(&path)
            .and_then(|()| self.check_below(key))
            .and_then(|()| match mode {
                PutMode::Always => fs::rename(&beside, &path).map(|()| Put::New),
                PutMode::IfAbsent => link(&beside, &path),
            });
        // After a rename there is nothing under this name any more.
        let _gone = fs::remove_file(&beside);
        let put = placed?;
        path.parent().map_or(Ok(()), sync)?;
        self.know(key);
        Ok(put)
    }

    fn each_below(&self, folder: &Path, each: &mut dyn FnMut(Entry)) -> io::Result<()> {
        let entries = match fs::read_dir(folder) {
            Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(()),
            entries => entries?,
        };
        for entry in entries {
            let entry = entry?;
            let path = entry.path();
            let found = match entry.metadata() {
                // It was removed meanwhile.
                Err(err) if err.kind() == io::ErrorKind::NotFound => continue,
                found => found?,
            };
            if found.is_dir() {
                self.each_below(&path, each)?;
            } else if let Some(key) = path.strip_prefix(&self.root).ok().and_then(Path::to_str) {
                each(Entry {
                    key: key.to_owned(),
                    size: found.len(),
                    modified: found.modified()?,
                });
            }
        }
        Ok(())
    }
}

impl Depot for FolderDepot {
    fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError> {
        let mut read = || {
            let path = self.path(key);
            let Some(found) = if_there(fs::symlink_metadata(&path))? else {
                self.check()?;
                return Ok(false);
            };
            // A link leads elsewhere, and a pipe has no end: neither holds what was stored.
            if !found.is_file() {
                return Ok(true);
            }
            let Some(mut file) = if_there(File::open(path))? else {
                return Ok(false);
            };
            self.know(key);
            let mut piece = vec![0; PIECE];
            loop {
                let n_read = file.read(&mut piece)?;
                match piece.get(..n_read) {
                    Some(bytes) if n_read > 0 => sink(bytes)?,
                    _ => return Ok(true),
                }
            }
        };
        read().map_err(|err| self.failed("get", key, err))
    }

    fn put(&self, key: &str, content: Content, mode: PutMode) -> Result<Put, DepotError> {
        let placed = self.place(key, content, mode);
        placed.map_err(|err| self.failed("put", key, err))
    }

    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        let look = || {
            let Some(found) = if_there(fs::metadata(self.path(key)))? else {
                self.check()?;
                return Ok(None);
            };
            Ok(Some(Entry {
                key: key.to_owned(),
                size: found.len(),
                modified: found.modified()?,
            }))
        };
        look().map_err(|err| self.failed("look for", key, err))
    }

    fn list(&self, prefix: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
        let listed = self
            .check()
            .and_then(|()| self.each_below(&self.path(prefix), each));
        listed.map_err(|err| self.failed("list", prefix, err))
    }

    fn remove(&self, key: &str) -> Result<(), DepotError> {
        let remove = || match if_there(fs::remove_file(self.path(key)))? {
            Some(()) => Ok(()),
            None => self.check(),
        };
        remove().map_err(|err| self.failed("remove", key, err))
    }
}

/// Links a file to its final name, which no two do.
fn link(beside: &Path, path: &Path) -> io::Result<Put> {
    match fs::hard_link(beside, path) {
        Ok(()) => Ok(Put::New),
        // The answer to a link that was made may have been lost, and the request repeated.
        Err(_) if fs::metadata(beside).is_ok_and(|found| found.nlink() == 2) => Ok(Put::New),
        Err(err) if err.kind() == io::ErrorKind::AlreadyExists => Ok(Put::There),
        // sshfs reports any failure as a refusal.
        Err(_) if File::open(path).is_ok() => Ok(Put::There),
        Err(err) => Err(err),
    }
}

fn write_synced(mut file: File, mut content: Content) -> io::Result<()> {
    let written = io::copy(&mut content.reader, &mut file)?;
    if written != content.size {
        let ended = format!("{written} bytes instead of {}", content.size);
        return Err(io::Error::new(io::ErrorKind::UnexpectedEof, ended));
    }
    file.flush()?;
    file.sync_all()
}

/// Syncs a folder's list of names; some network file systems cannot, and need not.
fn sync(folder: &Path) -> io::Result<()> {
    match File::open(folder)?.sync_all() {
        Err(err)
            if matches!(
                err.kind(),
                io::ErrorKind::Unsupported
                    | io::ErrorKind::InvalidInput
                    | io::ErrorKind::PermissionDenied
            ) =>
        {
            Ok(())
        }
        synced => synced,
    }
}

fn if_there<T>(found: io::Result<T>) -> io::Result<Option<T>> {
    match found {
        Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(None),
        found => found.map(Some),
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, sync::Barrier, thread};

    use super::*;

    fn put(depot: &FolderDepot, key: &str, bytes: &[u8], mode: PutMode) -> Put {
        let content = Content::of_bytes(bytes.to_vec());
        depot.put(key, content, mode).unwrap()
    }

    fn get(depot: &FolderDepot, key: &str) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let is_there = depot.get(key, &mut |piece| {
            bytes.extend_from_slice(piece);
            Ok(())
        });
        is_there.unwrap().then_some(bytes)
    }

    #[test]
    fn of_many_that_put_if_absent_one_wins_and_its_bytes_are_whole() {
        let folder = tempfile::tempdir().unwrap();
        for round in 0..50 {
            let key = format!("units/{round}");
            let start = Barrier::new(8);
            let won: Vec<u8> = thread::scope(|scope| {
                let tries: Vec<_> = (0..8)
                    .map(|number| {
                        let (start, key) = (&start, &key);
                        let depot = FolderDepot::new(folder.path());
                        scope.spawn(move || {
                            start.wait();
                            let bytes = vec![number; 100_000];
                            put(&depot, key, &bytes, PutMode::IfAbsent) == Put::New
                        })
                    })
                    .collect();
                let won = tries.into_iter().map(|one| one.join().unwrap());
                (0..)
                    .zip(won)
                    .filter(|(_, won)| *won)
                    .map(|(n, _)| n)
                    .collect()
            });
            assert_eq!(won.len(), 1, "{key}: {won:?} won");
            let there = get(&FolderDepot::new(folder.path()), &key).unwrap();
            assert_eq!(there, vec![won[0]; 100_000]);
        }
        assert_eq!(
            fs::read_dir(folder.path().join(WRITING)).unwrap().count(),
            0
        );
    }

    #[test]
    fn a_folder_that_is_away_or_not_mounted_is_no_empty_depot() {
        let parent = tempfile::tempdir().unwrap();
        let (folder, away) = (parent.path().join("depot"), parent.path().join("away"));
        fs::create_dir(&folder).unwrap();
        let depot = FolderDepot::new(&folder);
        assert_eq!(get(&depot, "units/one"), None, "a new one is empty");
        put(&depot, "units/one", b"one", PutMode::Always);
        fs::rename(&folder, &away).unwrap();
        // It went away after it had been looked at.
        let made = depot.make_parent(&folder.join("units/two/three"));
        assert_eq!(made.unwrap_err().kind(), io::ErrorKind::NotFound);
        assert!(!folder.exists());
        for is_mount_point in [false, true] {
            if is_mount_point {
                fs::create_dir(&folder).unwrap();
            }
            let failed = [
                depot.get("units/one", &mut |_| Ok(())).map(drop),
                depot.head("units/one").map(drop),
                depot.list("units", &mut |_| {}),
                depot.remove("units/one"),
            ];
            for failed in failed {
                let err = failed.unwrap_err();
                assert!(matches!(err, DepotError::Folder { .. }), "{err:?}");
                assert!(err.hint().unwrap().contains("mounted"));
            }
            let content = Content::of_bytes(Vec::new());
            assert!(depot.put("units/two", content, PutMode::Always).is_err());
        }
        fs::remove_dir(&folder).unwrap();
        fs::rename(&away, &folder).unwrap();
        assert_eq!(get(&depot, "units/one"), Some(b"one".to_vec()));
    }

    #[test]
    fn listed_are_exactly_the_files_below_a_prefix() {
        let folder = tempfile::tempdir().unwrap();
        let depot = FolderDepot::new(folder.path());
        for key in ["units/ab/one", "units/two", "unitsmore", "blobs/one"] {
            put(&depot, key, key.as_bytes(), PutMode::Always);
        }
        let mut keys = BTreeSet::new();
        depot
            .list("units", &mut |entry| {
                assert_eq!(entry.size, entry.key.len() as u64);
                keys.insert(entry.key);
            })
            .unwrap();
        assert_eq!(
            keys,
            BTreeSet::from(["units/ab/one", "units/two"].map(str::to_owned))
        );
        depot.remove("units/two").unwrap();
        depot.remove("units/two").unwrap();
        assert_eq!(get(&depot, "units/two"), None);
        assert_eq!(depot.head("units/two").unwrap(), None);
    }

    #[test]
    fn content_that_ends_early_or_fails_leaves_nothing() {
        struct Cut(usize);
        impl Read for Cut {
            fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
                if self.0 == 0 {
                    return Err(io::Error::other("cut"));
                }
                let n_read = into.len().min(self.0);
                self.0 -= n_read;
                Ok(n_read)
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let depot = FolderDepot::new(folder.path());
        for (size, reader) in [
            (100, Box::new(Cut(70)) as Box<dyn Read + Send>),
            (100, Box::new(io::Cursor::new(vec![0; 70]))),
        ] {
            let content = Content { size, reader };
            assert!(depot.put("key", content, PutMode::Always).is_err());
            assert_eq!(get(&depot, "key"), None);
        }
        assert_eq!(
            fs::read_dir(folder.path().join(WRITING)).unwrap().count(),
            0
        );
    }

    #[test]
    fn nothing_is_written_through_a_folder_that_is_a_link() {
        let (folder, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let depot = FolderDepot::new(folder.path());
        // The first folder may be on another disk.
        for (link, is_allowed) in [("blobs", true), ("units/aa", false)] {
            let link = folder.path().join(link);
            fs::create_dir_all(link.parent().unwrap()).unwrap();
            std::os::unix::fs::symlink(outside.path(), &link).unwrap();
            let key = format!(
                "{}/file",
                link.strip_prefix(folder.path()).unwrap().display()
            );
            let put = depot.put(&key, Content::of_bytes(Vec::new()), PutMode::Always);
            assert_eq!(put.is_ok(), is_allowed, "{key}");
            let there = fs::remove_file(outside.path().join("file"));
            assert_eq!(there.is_ok(), is_allowed, "{key}");
        }
    }

    #[test]
    fn a_folder_that_is_missing_is_an_error_and_is_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let depot = FolderDepot::new(&folder.path().join("not_mounted"));
        assert!(depot.head("key").is_err());
        assert!(depot.list("units", &mut |_| {}).is_err());
        assert!(depot.get("key", &mut |_| Ok(())).is_err());
        let content = Content::of_bytes(Vec::new());
        assert!(depot.put("key", content, PutMode::Always).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
