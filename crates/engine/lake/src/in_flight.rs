//! The units in flight of this process, dropped cleanly at an interrupt.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError},
    thread,
    time::{Duration, Instant},
};

use ::clock::lock;

/// Grace period for pending writes at an interrupt.
const GRACE: Duration = Duration::from_secs(2);

/// The units in flight.
#[derive(Default)]
pub(crate) struct InFlight {
    /// Locked while a folder is made and entered; locked for good to stop all further units.
    folders: Mutex<BTreeSet<PathBuf>>,
    /// Read-locked while a file is written under its final name; write-locked to stop all further
    /// writes.
    gate: RwLock<()>,
}

impl InFlight {
    /// Makes the folder of a unit; blocks forever once the flight is dropped, so that no unit begins
    /// after an interrupt.
    pub(crate) fn begin(&self, folder: &Path) -> io::Result<()> {
        let mut folders = lock(&self.folders);
        fs::create_dir_all(folder)?;
        folders.insert(folder.to_owned());
        Ok(())
    }

    pub(crate) fn end(&self, folder: &Path) {
        lock(&self.folders).remove(folder);
    }

    /// Permits a commit; blocks forever once the flight is dropped.
    pub(crate) fn permit_commit(&self) -> RwLockReadGuard<'_, ()> {
        self.gate.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for pending commits, blocks further ones and new units while the guard lives, and
    /// removes the units in flight. Returns the number of units dropped. Does not wait for units
    /// that wait for another process: they have written nothing.
    pub(crate) fn abort(&self) -> (impl Sized + '_, usize) {
        let gate = self.close();
        let folders = lock(&self.folders);
        for folder in folders.iter() {
            // A stage may still be writing into it, so further tries may be needed; leftovers are
            // removed by a later run.
            let asked = Instant::now();
            while fs::remove_dir_all(folder).is_err() && folder.exists() && asked.elapsed() < GRACE
            {
                thread::sleep(GRACE / 100);
            }
        }
        let n_dropped = folders.len();
        ((gate, folders), n_dropped)
    }

    fn close(&self) -> Option<RwLockWriteGuard<'_, ()>> {
        let asked = Instant::now();
        while asked.elapsed() < GRACE {
            match self.gate.try_write() {
                Ok(gate) => return Some(gate),
                Err(TryLockError::Poisoned(gate)) => return Some(gate.into_inner()),
                Err(TryLockError::WouldBlock) => thread::sleep(GRACE / 100),
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_unit_begins_after_an_interrupt() {
        let place = tempfile::tempdir().unwrap();
        let [first, second] = ["first", "second"].map(|name| place.path().join(name));
        let flight = InFlight::default();
        flight.begin(&first).unwrap();
        let (guard, n_dropped) = flight.abort();
        assert_eq!(n_dropped, 1);
        assert!(!first.exists());
        thread::scope(|scope| {
            let begun = scope.spawn(|| flight.begin(&second));
            thread::sleep(GRACE / 10);
            assert!(!second.exists());
            drop(guard);
            begun.join().unwrap().unwrap();
        });
        assert!(second.exists());
    }
}
