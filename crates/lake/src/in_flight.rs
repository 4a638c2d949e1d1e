//! The units in flight of this process, dropped cleanly at an interrupt.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError},
    thread,
    time::{Duration, Instant},
};

use crate::mutex::lock;

/// Grace period for pending writes at an interrupt.
const GRACE: Duration = Duration::from_secs(2);

/// The units in flight.
#[derive(Default)]
pub(crate) struct InFlight {
    folders: Mutex<BTreeSet<PathBuf>>,
    /// Read-locked while a file is written under its final name; write-locked to stop all further
    /// writes.
    gate: RwLock<()>,
}

impl InFlight {
    pub(crate) fn begin(&self, folder: &Path) {
        lock(&self.folders).insert(folder.to_owned());
    }

    pub(crate) fn end(&self, folder: &Path) {
        lock(&self.folders).remove(folder);
    }

    /// Permits a commit; blocks forever once the flight is dropped.
    pub(crate) fn permit_commit(&self) -> RwLockReadGuard<'_, ()> {
        self.gate.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for pending commits, blocks further ones while the guard lives, and removes the units
    /// in flight. Returns the number of units dropped. Does not wait for units that wait for
    /// another process: they have written nothing.
    pub(crate) fn abort(&self) -> (Option<RwLockWriteGuard<'_, ()>>, usize) {
        let gate = self.close();
        let folders = lock(&self.folders);
        for folder in folders.iter() {
            // A stage may still be writing into it, so a second try may be needed; leftovers are
            // removed by a later run.
            let _left = fs::remove_dir_all(folder).or_else(|_| fs::remove_dir_all(folder));
        }
        (gate, folders.len())
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
