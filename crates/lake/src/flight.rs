//! What this process is making, so that it can be dropped cleanly when somebody stops the program.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError},
    thread,
    time::{Duration, Instant},
};

/// How long a stopped program lets what is being kept come to its end.
const PATIENCE: Duration = Duration::from_secs(2);

/// The units in flight.
#[derive(Default)]
pub(crate) struct Flight {
    folders: Mutex<BTreeSet<PathBuf>>,
    /// Held for reading while something is written under its final name; held for writing from the
    /// moment in which nothing may be written any more.
    gate: RwLock<()>,
}

impl Flight {
    pub(crate) fn begin(&self, folder: &Path) {
        let mut folders = self.folders.lock().unwrap_or_else(PoisonError::into_inner);
        folders.insert(folder.to_owned());
    }

    pub(crate) fn end(&self, folder: &Path) {
        let mut folders = self.folders.lock().unwrap_or_else(PoisonError::into_inner);
        folders.remove(folder);
    }

    /// Lets something be kept; waits for ever once the flight is dropped.
    pub(crate) fn land(&self) -> RwLockReadGuard<'_, ()> {
        self.gate.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until nothing is being kept, lets nothing be kept any more while the guard lives, and
    /// removes what is in the making. Returns the number of units dropped. What waits for another
    /// process meanwhile is not waited for: it has written nothing.
    pub(crate) fn drop_all(&self) -> (Option<RwLockWriteGuard<'_, ()>>, usize) {
        let gate = self.close();
        let folders = self.folders.lock().unwrap_or_else(PoisonError::into_inner);
        for folder in folders.iter() {
            // A stage may write into it at this very moment, so a second try may be needed; what is
            // left all the same is removed by whoever makes the unit next.
            let _left = fs::remove_dir_all(folder).or_else(|_| fs::remove_dir_all(folder));
        }
        (gate, folders.len())
    }

    fn close(&self) -> Option<RwLockWriteGuard<'_, ()>> {
        let asked = Instant::now();
        while asked.elapsed() < PATIENCE {
            match self.gate.try_write() {
                Ok(gate) => return Some(gate),
                Err(TryLockError::Poisoned(gate)) => return Some(gate.into_inner()),
                Err(TryLockError::WouldBlock) => thread::sleep(PATIENCE / 100),
            }
        }
        None
    }
}
