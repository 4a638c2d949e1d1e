//! Stamps of verified files, so that they need not be read again.

use std::{collections::HashMap, sync::Mutex};

use ::clock::lock;
use dataflow::{Digest, Stamp};

/// The stamps of files when their bytes were last verified, by digest.
#[derive(Default)]
pub(crate) struct Stamps(Mutex<VerifiedStamps>);

#[derive(Default)]
struct VerifiedStamps {
    stamps: HashMap<Digest, Stamp>,
    learned: bool,
}

impl Stamps {
    /// Returns the stamp of a file, if it was verified.
    pub(crate) fn get(&self, digest: &Digest) -> Option<Stamp> {
        lock(&self.0).stamps.get(digest).copied()
    }

    /// Loads the stamps of other processes; this process's own take precedence.
    pub(crate) fn recall(&self, stamps: impl IntoIterator<Item = (Digest, Stamp)>) {
        let mut known = lock(&self.0);
        for (digest, stamp) in stamps {
            known.stamps.entry(digest).or_insert(stamp);
        }
    }

    /// Records the stamp of a file that was just verified.
    pub(crate) fn learn(&self, digest: &Digest, stamp: Stamp) {
        let mut known = lock(&self.0);
        known.learned |= known.stamps.insert(*digest, stamp) != Some(stamp);
    }

    /// Removes a file, so that it is read the next time.
    pub(crate) fn forget(&self, digest: &Digest) {
        let mut known = lock(&self.0);
        known.learned |= known.stamps.remove(digest).is_some();
    }

    /// Whether anything was recorded or removed.
    pub(crate) fn learned(&self) -> bool {
        lock(&self.0).learned
    }
}
