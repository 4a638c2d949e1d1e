//! What this process is making, so that it can be dropped cleanly when somebody stops the program.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard},
};

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
    /// removes what is in the making, with its locks. Returns the number of units dropped.
    pub(crate) fn drop_all(&self, locks: &Path) -> (RwLockWriteGuard<'_, ()>, usize) {
        let gate = self.gate.write().unwrap_or_else(PoisonError::into_inner);
        let folders = self.folders.lock().unwrap_or_else(PoisonError::into_inner);
        for folder in folders.iter() {
            // A stage may write into it at this very moment, so a second try may be needed; what is
            // left all the same is removed by whoever makes the unit next.
            let _left = fs::remove_dir_all(folder).or_else(|_| fs::remove_dir_all(folder));
            if let Some(unit) = folder.file_name() {
                let _left = fs::remove_file(locks.join(unit));
            }
        }
        (gate, folders.len())
    }
}
