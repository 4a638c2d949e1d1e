//! Stamps of files whose bytes were seen to be right, so that they need not be read again.

use std::{
    collections::HashMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use dataflow::Digest;

use crate::stamp::Stamp;

/// The stamps that files had when their bytes were last seen to be right, by digest.
#[derive(Default)]
pub(crate) struct Stamps(Mutex<Known>);

#[derive(Default)]
struct Known {
    stamps: HashMap<Digest, Stamp>,
    learned: bool,
}

impl Stamps {
    fn known(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the stamp of a file, if its bytes were seen to be right.
    pub(crate) fn get(&self, digest: &Digest) -> Option<Stamp> {
        self.known().stamps.get(digest).copied()
    }

    /// Recalls what another process saw, without what this one has seen itself.
    pub(crate) fn recall(&self, stamps: impl IntoIterator<Item = (Digest, Stamp)>) {
        let mut known = self.known();
        for (digest, stamp) in stamps {
            known.stamps.entry(digest).or_insert(stamp);
        }
    }

    /// Remembers the stamp of a file whose bytes were just seen to be right.
    pub(crate) fn learn(&self, digest: &Digest, stamp: Stamp) {
        let mut known = self.known();
        known.learned |= known.stamps.insert(*digest, stamp) != Some(stamp);
    }

    /// Forgets a file, so that it is read the next time.
    pub(crate) fn forget(&self, digest: &Digest) {
        let mut known = self.known();
        known.learned |= known.stamps.remove(digest).is_some();
    }

    /// Whether anything was learned or forgotten.
    pub(crate) fn learned(&self) -> bool {
        self.known().learned
    }
}
