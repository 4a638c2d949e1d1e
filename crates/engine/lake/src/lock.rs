//! Locks between processes that use one lake.
//!
//! A lock is a file that its holder has locked; the system releases it when the holder dies, so a
//! dead owner's lock is taken over at once. The file describes the holder. The last holder removes
//! it.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Seek, Write},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    sync::Mutex,
};

use ::clock::lock;
use dataflow::{Digest, UnitName};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    atomic::{self, io_error},
    clock,
    folder::names_in,
};

/// A lock, released and removed on drop.
pub(crate) struct Lock {
    path: PathBuf,
    file: File,
}

/// The holder of a lock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Holder {
    pid: u32,
    host: String,
    what: String,
}

impl Holder {
    /// This process, with its activity.
    fn this(what: &str) -> Self {
        Self {
            pid: std::process::id(),
            host: clock::host(),
            what: what.to_owned(),
        }
    }

    /// The holder, in words.
    fn describe(&self) -> String {
        if self.host == clock::host() {
            format!("process {}, which makes {}", self.pid, self.what)
        } else {
            format!(
                "process {} on `{}`, which makes {}",
                self.pid, self.host, self.what
            )
        }
    }
}

/// The locks of a lake, each a file of its folder.
pub(crate) struct Locks {
    folder: PathBuf,
    /// Held while this process writes to the lake, so that others know that it is alive.
    alive: Mutex<Option<Lock>>,
}

/// The lock between taking records into use (shared) and collecting them (exclusive).
const COLLECTING: &str = "collecting";

/// Name of the machine for which the lake is reserved.
const MACHINE: &str = "machine";

/// Filename prefix of process liveness locks.
const PROCESS: &str = "process-";

/// Callback with the lock's holder for a process that waits.
pub(crate) type Waiting<'a> = dyn Fn(&str) + 'a;

impl Locks {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            alive: Mutex::default(),
        }
    }

    /// Announces that this process writes to the lake.
    pub(crate) fn enter(&self) -> Result<(), LakeError> {
        let mut alive = lock(&self.alive);
        if alive.is_none() {
            let name = format!("{PROCESS}{}", atomic::process_name());
            *alive = self.try_take(&name, "artifacts")?;
        }
        Ok(())
    }

    /// Reserves the lake for this machine, which others must not write to, since they do not see its
    /// locks; returns the machine for which it is reserved.
    pub(crate) fn reserve(&self) -> Result<String, LakeError> {
        let path = self.folder.join(MACHINE);
        atomic::make_parent(&path)?;
        let reserved = File::create_new(&path).and_then(|mut file| {
            let host = clock::host();
            file.write_all(host.as_bytes()).map(|()| host)
        });
        match reserved {
            Err(err) if err.kind() == io::ErrorKind::AlreadyExists => {
                fs::read_to_string(&path).map_err(io_error("read", &path))
            }
            reserved => reserved.map_err(io_error("write", &path)),
        }
    }

    /// Announces that this process no longer writes to the lake.
    pub(crate) fn leave(&self) {
        lock(&self.alive).take();
    }

    /// Whether a process that wrote to the lake is still alive.
    pub(crate) fn is_alive(&self, process: &str) -> bool {
        self.is_held(&format!("{PROCESS}{process}"))
    }

    /// Names of other processes that write to the lake.
    pub(crate) fn other_processes(&self) -> Result<Vec<String>, LakeError> {
        let mine = atomic::process_name();
        let names = names_in(&self.folder)?;
        let processes = names.iter().filter_map(|name| name.strip_prefix(PROCESS));
        let others = processes.filter(|process| *process != mine && self.is_alive(process));
        Ok(others.map(str::to_owned).collect())
    }

    /// Waits for the lock of this unit; if another process holds it, calls `waiting` once with the
    /// holder.
    pub(crate) fn unit(
        &self,
        fingerprint: &Digest,
        unit: &UnitName,
        waiting: &Waiting,
    ) -> Result<Lock, LakeError> {
        self.wait_for(&fingerprint.to_hex(), &unit.to_string(), waiting)
    }

    /// Locks repairs, and changes of repaired files.
    pub(crate) fn lock_repair(&self) -> Result<Lock, LakeError> {
        self.wait_for("repair", "what was lost anew", &|_| {})
    }

    /// Locks the published files of a pipeline.
    pub(crate) fn lock_publication(&self, pipeline: &str) -> Result<Lock, LakeError> {
        let name = format!("published-{pipeline}");
        self.wait_for(&name, "what the pipeline shows", &|_| {})
    }

    /// Locks the numbering of runs.
    pub(crate) fn lock_numbering(&self) -> Result<Lock, LakeError> {
        self.wait_for("runs", "a record of its run", &|_| {})
    }

    /// Locks the cache of digests of files outside the lake.
    pub(crate) fn lock_sources(&self) -> Result<Lock, LakeError> {
        self.wait_for("sources", "what it knows of files outside", &|_| {})
    }

    /// Waits for garbage collection to end, and blocks it.
    pub(crate) fn block_collection(&self) -> Result<File, LakeError> {
        self.stay(COLLECTING, File::lock_shared)
    }

    /// Waits until no process stores or takes anything into use, and blocks both.
    pub(crate) fn lock_collection(&self) -> Result<File, LakeError> {
        self.stay(COLLECTING, File::lock)
    }

    /// Names of the stale locks of dead processes.
    pub(crate) fn stale_locks(&self) -> Result<Vec<String>, LakeError> {
        let mut names = names_in(&self.folder)?;
        names.retain(|name| ![COLLECTING, MACHINE].contains(&&**name) && !self.is_held(name));
        Ok(names)
    }

    fn wait_for(&self, name: &str, what: &str, waiting: &Waiting) -> Result<Lock, LakeError> {
        let path = self.folder.join(name);
        let mut told = false;
        loop {
            let file = open(&path)?;
            if !lock_now(&path, &file)? {
                if !told {
                    told = true;
                    waiting(&holder(&path));
                }
                file.lock().map_err(io_error("lock", &path))?;
            }
            if let Some(lock) = confirm(&path, file, what)? {
                return Ok(lock);
            }
        }
    }

    /// Takes the lock of this name if it is free.
    pub(crate) fn try_take(&self, name: &str, what: &str) -> Result<Option<Lock>, LakeError> {
        let path = self.folder.join(name);
        loop {
            let file = open(&path)?;
            if !lock_now(&path, &file)? {
                return Ok(None);
            }
            if let Some(lock) = confirm(&path, file, what)? {
                return Ok(Some(lock));
            }
        }
    }

    /// Locks a permanent file, and checks that it was not removed meanwhile.
    fn stay(&self, name: &str, lock: impl Fn(&File) -> io::Result<()>) -> Result<File, LakeError> {
        let path = self.folder.join(name);
        loop {
            let file = open(&path)?;
            lock(&file).map_err(io_error("lock", &path))?;
            if is_at(&path, &file)? {
                return Ok(file);
            }
        }
    }

    /// Whether the lock of this name is held.
    pub(crate) fn is_held(&self, name: &str) -> bool {
        let file = atomic::open(&self.folder.join(name));
        file.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }
}

/// Locks a file if it is free; returns whether it is locked now.
fn lock_now(path: &Path, file: &File) -> Result<bool, LakeError> {
    match file.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(err)) => Err(io_error("lock", path)(err)),
    }
}

/// Whether a path still leads to an open file.
fn is_at(path: &Path, file: &File) -> Result<bool, LakeError> {
    let opened = file.metadata().map_err(io_error("lock", path))?;
    let same = |there: fs::Metadata| (there.dev(), there.ino()) == (opened.dev(), opened.ino());
    Ok(fs::metadata(path).is_ok_and(same))
}

fn open(path: &Path) -> Result<File, LakeError> {
    loop {
        atomic::make_parent(path)?;
        if atomic::is_no_file(path) {
            atomic::remove_if_there(path)?;
        }
        let opened = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path);
        match opened {
            // The folder was removed between the two calls.
            Err(err) if err.kind() == io::ErrorKind::NotFound => {}
            opened => return opened.map_err(io_error("write", path)),
        }
    }
}

/// Checks that the locked file is still at its path, and writes the holder into it.
fn confirm(path: &Path, mut file: File, what: &str) -> Result<Option<Lock>, LakeError> {
    if !is_at(path, &file)? {
        return Ok(None);
    }
    let text = serde_json::to_vec(&Holder::this(what)).unwrap_or_default();
    file.set_len(0)
        .and_then(|()| file.rewind())
        .and_then(|()| file.write_all(&text))
        .map_err(io_error("write", path))?;
    Ok(Some(Lock {
        path: path.to_owned(),
        file,
    }))
}

/// Description of a lock's holder.
fn holder(path: &Path) -> String {
    let text = atomic::read_if_there(path).ok().flatten();
    let text = text.unwrap_or_default();
    serde_json::from_slice::<Holder>(&text).map_or_else(
        |_unreadable| "another process".to_owned(),
        |holder| holder.describe(),
    )
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Removed while still locked: waiting processes see that it is gone and retry.
        if is_at(&self.path, &self.file).unwrap_or(false) {
            let _gone = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn one_holder_at_a_time_and_the_file_goes_with_the_last() {
        let folder = tempfile::tempdir().unwrap();
        let locks = Locks::new(folder.path().to_owned());
        let (inside, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let lock = locks.wait_for("name", "a thing", &|_| {}).unwrap();
                        most.fetch_max(inside.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                        inside.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert_eq!(most.into_inner(), 1);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn waiter_sees_lock_holder() {
        let folder = tempfile::tempdir().unwrap();
        let locks = Locks::new(folder.path().to_owned());
        let what = "screen.rollouts `a`";
        let lock = locks.wait_for("name", what, &|_| {}).unwrap();
        assert!(locks.is_held("name"));
        assert!(locks.try_take("name", "b").unwrap().is_none());
        let told = holder(&folder.path().join("name"));
        let pid = std::process::id();
        assert_eq!(told, format!("process {pid}, which makes {what}"));
        drop(lock);
        assert!(!locks.is_held("name"));
    }
}
