//! Empty files that stand for facts which must survive the process: the items to be sent, and the
//! blobs that were left in the depot.

use std::{
    collections::BTreeSet,
    fs::File,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, OnceLock},
};

use ::clock::lock;
use dataflow::Digest;

use crate::{
    LakeError,
    atomic::{self, io_error, make_parent},
    folder::{Folder, names_in},
};

/// Prefix, before a run's number, of its mark in the outbox.
const RUN: &str = "run-";

/// An item to be sent to the depot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Item {
    /// A unit, by its fingerprint.
    Unit(Digest),
    /// A run, by its number.
    Run(u64),
}

/// Marks of the items to be sent.
#[derive(Debug, Clone)]
pub(crate) struct Outbox(PathBuf);

impl Outbox {
    pub(crate) fn new(folder: &Folder) -> Self {
        Self(folder.outbox())
    }

    /// Lists the items to be sent, the units first.
    pub(crate) fn list(&self) -> Result<Vec<Item>, LakeError> {
        let names = names_in(&self.0)?;
        let items = names
            .iter()
            .filter_map(|name| match name.strip_prefix(RUN) {
                Some(number) => number.parse().ok().map(Item::Run),
                None => name.parse().ok().map(Item::Unit),
            });
        let mut items: Vec<Item> = items.collect();
        items.sort_unstable();
        Ok(items)
    }

    pub(crate) fn add(&self, item: Item) -> Result<(), LakeError> {
        mark(&self.path(item))
    }

    pub(crate) fn remove(&self, item: Item) -> Result<(), LakeError> {
        atomic::remove_if_there(&self.path(item))
    }

    fn path(&self, item: Item) -> PathBuf {
        self.0.join(match item {
            Item::Unit(fingerprint) => fingerprint.to_hex(),
            Item::Run(number) => format!("{RUN}{number}"),
        })
    }
}

/// Blobs that are in the depot and not here, until something asks for them.
pub(crate) struct RemoteBlobs {
    folder: PathBuf,
    /// Those of earlier processes, and those found by this one.
    known: OnceLock<Mutex<BTreeSet<Digest>>>,
}

impl RemoteBlobs {
    pub(crate) fn new(folder: &Folder) -> Self {
        Self {
            folder: folder.unfetched(),
            known: OnceLock::new(),
        }
    }

    fn known(&self) -> MutexGuard<'_, BTreeSet<Digest>> {
        let known = self.known.get_or_init(|| {
            // Without its marks a blob is asked for again.
            let names = names_in(&self.folder).unwrap_or_default();
            Mutex::new(names.iter().filter_map(|name| name.parse().ok()).collect())
        });
        lock(known)
    }

    pub(crate) fn contains(&self, blob: &Digest) -> bool {
        self.known().contains(blob)
    }

    /// Notes that a blob is in the depot, for this process.
    pub(crate) fn note(&self, blob: &Digest) {
        self.known().insert(*blob);
    }

    /// Marks a blob for later processes.
    pub(crate) fn keep(&self, blob: &Digest) -> Result<(), LakeError> {
        mark(&self.folder.join(blob.to_hex()))
    }

    /// Removes a blob that is here now, or that is not in the depot.
    pub(crate) fn remove(&self, blob: &Digest) {
        if self.known().remove(blob) {
            // A leftover costs a request.
            let _left = atomic::remove_if_there(&self.folder.join(blob.to_hex()));
        }
    }
}

fn mark(path: &Path) -> Result<(), LakeError> {
    make_parent(path)?;
    File::create(path)
        .map(drop)
        .map_err(io_error("write", path))
}
