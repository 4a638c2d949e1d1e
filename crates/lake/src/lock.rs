//! Locks between processes that use one lake.
//!
//! A lock is a file that its holder has locked; the system lets go of it when the holder dies, so a
//! dead owner's lock is taken over at once. The file says who holds it. The last holder removes it.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Seek, Write},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    atomic::{self, io_error},
    clock,
};

/// A lock, let go of and removed when it is dropped.
pub(crate) struct Lock {
    path: PathBuf,
    file: File,
}

/// Who holds a lock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Holder {
    pid: u32,
    host: String,
    what: String,
}

impl Holder {
    /// This process, doing this.
    fn this(what: &str) -> Self {
        Self {
            pid: std::process::id(),
            host: clock::host(),
            what: what.to_owned(),
        }
    }

    /// Who it is, in words.
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

/// Waits until nobody else has the lock of this name under `locks`; if somebody has, `waiting` is
/// told once who.
pub(crate) fn wait_for(
    locks: &Path,
    name: &str,
    what: &str,
    waiting: &dyn Fn(&str),
) -> Result<Lock, LakeError> {
    let path = locks.join(name);
    let mut told = false;
    loop {
        let file = open(&path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                if !told {
                    told = true;
                    waiting(&holder(&path));
                }
                file.lock().map_err(io_error("lock", &path))?;
            }
            Err(TryLockError::Error(err)) => return Err(io_error("lock", &path)(err)),
        }
        if let Some(lock) = confirm(&path, file, what)? {
            return Ok(lock);
        }
    }
}

/// Takes the lock of this name if nobody has it.
pub(crate) fn try_take(locks: &Path, name: &str, what: &str) -> Result<Option<Lock>, LakeError> {
    let path = locks.join(name);
    loop {
        let file = open(&path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(err)) => return Err(io_error("lock", &path)(err)),
        }
        if let Some(lock) = confirm(&path, file, what)? {
            return Ok(Some(lock));
        }
    }
}

/// Waits until nobody excludes others from what this name stands for. Many may share it; the file
/// stays where it is.
pub(crate) fn share(locks: &Path, name: &str) -> Result<File, LakeError> {
    stay(&locks.join(name), File::lock_shared)
}

/// Waits until nobody shares what this name stands for, and keeps others from it.
pub(crate) fn exclude(locks: &Path, name: &str) -> Result<File, LakeError> {
    stay(&locks.join(name), File::lock)
}

/// Locks a file that nobody removes, and makes sure that nobody did.
fn stay(path: &Path, lock: impl Fn(&File) -> io::Result<()>) -> Result<File, LakeError> {
    loop {
        let file = open(path)?;
        lock(&file).map_err(io_error("lock", path))?;
        if is_at(path, &file)? {
            return Ok(file);
        }
    }
}

/// Whether a path still leads to an open file.
fn is_at(path: &Path, file: &File) -> Result<bool, LakeError> {
    let opened = file.metadata().map_err(io_error("lock", path))?;
    let same = |there: fs::Metadata| (there.dev(), there.ino()) == (opened.dev(), opened.ino());
    Ok(fs::metadata(path).is_ok_and(same))
}

/// Whether somebody has the lock of this name.
pub(crate) fn is_held(locks: &Path, name: &str) -> bool {
    let file = File::open(locks.join(name));
    file.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

fn open(path: &Path) -> Result<File, LakeError> {
    loop {
        atomic::make_parent(path)?;
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

/// Makes sure that the file locked is the one that others will find, and writes into it who has it.
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

/// Who holds a lock, in words.
fn holder(path: &Path) -> String {
    let text = fs::read(path).unwrap_or_default();
    serde_json::from_slice::<Holder>(&text).map_or_else(
        |_unreadable| "another process".to_owned(),
        |holder| holder.describe(),
    )
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Removed while it is still locked: who waits for it finds that it is gone and begins anew.
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
        let (inside, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let lock = wait_for(folder.path(), "name", "a thing", &|_| {}).unwrap();
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
    fn who_waits_is_told_for_whom() {
        let folder = tempfile::tempdir().unwrap();
        let lock = wait_for(folder.path(), "name", "screen.rollouts `a`", &|_| {}).unwrap();
        assert!(is_held(folder.path(), "name"));
        assert!(try_take(folder.path(), "name", "b").unwrap().is_none());
        let told = holder(&folder.path().join("name"));
        let expected = format!(
            "process {}, which makes screen.rollouts `a`",
            std::process::id()
        );
        assert_eq!(told, expected);
        drop(lock);
        assert!(!is_held(folder.path(), "name"));
    }
}
