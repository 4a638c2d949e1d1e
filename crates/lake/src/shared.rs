//! Sharing of results between a lake and a depot, which several machines use.
//!
//! A lake with a depot finds in it what it does not have: a record is looked up there, and a blob is
//! fetched when something asks for its bytes. What the lake makes is sent there beside the work. All of it is
//! optional: a lake goes on without a depot that is down, and checks its bytes as they come.

mod check;
mod claims;
mod collect;
mod fetch;
mod index;
pub(crate) mod keys;
mod marks;
mod messages;
mod remote;
mod send;

use std::{
    collections::{BTreeSet, HashSet},
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use dataflow::{Digest, FileRef, RecordOutcome};
use depot::{Depot, DepotError, Entry, Traffic};

use crate::{LakeError, blobs::Blobs, folder::Folder, mutex::lock, records::Records};

pub(crate) use self::{index::SharedRun, send::key_of};
use self::{
    index::{FoundRecord, Index},
    marks::{Item, Outbox, Unfetched},
    remote::Remote,
    send::Sender,
};

/// Report of the results that a lake shared with its depot, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SharingReport {
    /// Traffic of the link.
    pub traffic: Traffic,
    /// Units whose results were found in the depot.
    pub n_units_found: usize,
    /// Files fetched.
    pub n_files_fetched: usize,
    /// Units sent.
    pub n_units_sent: usize,
    /// Units that were not sent because a file of theirs is missing or damaged here.
    pub n_units_damaged: usize,
    /// Units that are still to be sent.
    pub n_units_waiting: usize,
    /// Files that the depot has damaged.
    pub n_damaged: usize,
    /// Units that came out differently here than on the machine, named second, that sent them first.
    pub differing: Vec<(String, String)>,
    /// Why the depot is not asked any more, if it is not.
    pub offline: Option<String>,
}

/// The depot of a lake, and its known content.
pub(crate) struct Shared {
    remote: Arc<Remote>,
    folder: Folder,
    index: Index,
    pub(crate) outbox: Outbox,
    pub(crate) unfetched: Unfetched,
    sender: Sender,
    /// Blobs that the depot does not have, or has damaged.
    lost: Arc<Mutex<BTreeSet<Digest>>>,
    /// Blobs that came damaged.
    damaged: Mutex<BTreeSet<Digest>>,
    /// Records that were found in the depot and are not kept here yet.
    found: Mutex<Vec<FoundRecord>>,
    n_found: AtomicUsize,
    n_fetched: AtomicUsize,
}

impl Shared {
    pub(crate) fn new(depot: Arc<dyn Depot>, folder: &Folder) -> Self {
        let remote = Arc::new(Remote::new(depot));
        let lost = Arc::default();
        Self {
            sender: Sender::new(Arc::clone(&remote), folder, Arc::clone(&lost)),
            remote,
            folder: folder.clone(),
            index: Index::default(),
            outbox: Outbox::new(folder),
            unfetched: Unfetched::new(folder),
            lost,
            damaged: Mutex::default(),
            found: Mutex::default(),
            n_found: AtomicUsize::new(0),
            n_fetched: AtomicUsize::new(0),
        }
    }

    /// Begins to look for the units of a pipeline; nothing is asked of the depot yet.
    pub(crate) fn enter(&self, pipeline: &str) {
        self.index.enter(pipeline);
    }

    /// Asks for the record of a unit that another machine has just made.
    pub(crate) fn expect(&self, fingerprint: &Digest) {
        self.index.expect(&self.remote, fingerprint);
    }

    /// Marks files to be sent again, of which the depot may have lost some.
    pub(crate) fn doubt<'f>(&self, files: impl Iterator<Item = &'f FileRef>) {
        lock(&self.lost).extend(files.map(|file| file.digest));
    }

    /// Sends a file that the depot lacks; returns whether it is there now.
    pub(crate) fn offer(&self, file: &FileRef) -> Result<bool, LakeError> {
        self.sender.offer(file)
    }

    /// Whether a blob was left in the depot.
    pub(crate) fn has(&self, blob: &Digest) -> bool {
        self.unfetched.contains(blob)
    }

    /// Whether a blob can be fetched, as far as is known without asking.
    pub(crate) fn can_fetch(&self, blob: &Digest) -> bool {
        self.has(blob) && !self.is_offline()
    }

    pub(crate) fn is_offline(&self) -> bool {
        self.remote.idle().offline().is_some()
    }

    /// Returns a result from the depot, whose files can be fetched.
    pub(crate) fn lookup(
        &self,
        records: &Records,
        blobs: &Blobs,
        fingerprint: &Digest,
    ) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        let Some((stored, recipe)) = self.index.record(&self.remote, records, fingerprint)? else {
            return Ok(None);
        };
        let files = stored
            .outcome
            .files()
            .into_iter()
            .flat_map(|files| files.values());
        let absent: Vec<Digest> = files
            .map(|file| file.digest)
            .filter(|blob| !blobs.path(blob).exists())
            .collect();
        let lost = lock(&self.lost);
        let cannot_come = |blob: &Digest| self.is_offline() || lost.contains(blob);
        if absent.iter().any(cannot_come) {
            return Ok(None);
        }
        for blob in &absent {
            self.unfetched.note(blob);
        }
        let outcome = Arc::new(stored.outcome.clone());
        lock(&self.found).push((stored, recipe));
        self.n_found.fetch_add(1, Ordering::Relaxed);
        Ok(Some(outcome))
    }

    /// Whether records were found that are not stored here yet.
    pub(crate) fn has_found(&self) -> bool {
        !lock(&self.found).is_empty()
    }

    /// Stores the records that were found, as if they had been made here.
    pub(crate) fn adopt(&self, records: &Records, blobs: &Blobs) -> Result<(), LakeError> {
        let found = std::mem::take(&mut *lock(&self.found));
        for (stored, recipe) in found {
            for file in stored
                .outcome
                .files()
                .into_iter()
                .flat_map(|files| files.values())
            {
                if !blobs.path(&file.digest).exists() {
                    self.unfetched.keep(&file.digest)?;
                }
            }
            records.adopt(&stored, &recipe)?;
            self.index.forget(&stored.fingerprint);
        }
        Ok(())
    }

    /// Puts a unit that is about to be stored into the outbox.
    pub(crate) fn send_unit(&self, fingerprint: &Digest) -> Result<(), LakeError> {
        self.outbox.add(Item::Unit(*fingerprint))
    }

    /// Puts a run into the outbox, to be sent after its units.
    pub(crate) fn send_run(&self, number: u64) -> Result<(), LakeError> {
        self.outbox.add(Item::Run(number))
    }

    /// Lists the fingerprints of all records in the depot.
    pub(crate) fn fingerprints(&self) -> Result<HashSet<Digest>, LakeError> {
        let offline = || DepotError::Offline {
            why: self.remote.idle().offline().unwrap_or_default().to_owned(),
        };
        let found = Index::fingerprints(&self.remote);
        found.ok_or_else(|| offline().into())
    }

    /// Lists the files below a prefix.
    pub(crate) fn list(&self, prefix: &str) -> Result<Vec<Entry>, LakeError> {
        Ok(self.remote.link().list(prefix)?)
    }

    /// Returns a small file, if there is one.
    pub(crate) fn read(&self, key: &str) -> Result<Option<Vec<u8>>, LakeError> {
        Ok(self.remote.link().read(key)?)
    }

    /// The error of a depot that is not asked any more, if it is not.
    pub(crate) fn offline(&self) -> Option<LakeError> {
        let why = self.remote.idle().offline()?.to_owned();
        Some(DepotError::Offline { why }.into())
    }

    /// The error of a blob that the depot has lost.
    pub(crate) fn lost(blob: &Digest) -> LakeError {
        LakeError::LostInDepot {
            key: keys::blob(blob),
        }
    }

    /// Begins to send.
    pub(crate) fn start(&self) {
        self.sender.start();
    }

    /// Waits until everything is sent, the depot is offline, or for `patience`.
    pub(crate) fn finish(&self, patience: Duration) -> Result<(), LakeError> {
        if !self.outbox.list()?.is_empty() {
            self.sender.finish(patience);
        }
        Ok(())
    }

    pub(crate) fn report(&self) -> Result<SharingReport, LakeError> {
        let link = self.remote.idle();
        let sent = self.sender.sent();
        let waiting = self.outbox.list()?;
        let is_unit = |item: &&Item| matches!(item, Item::Unit(_));
        Ok(SharingReport {
            traffic: link.traffic(),
            n_units_found: self.n_found.load(Ordering::Relaxed),
            n_files_fetched: self.n_fetched.load(Ordering::Relaxed),
            n_units_sent: sent.n_units,
            n_units_damaged: sent.n_damaged,
            n_units_waiting: waiting.iter().filter(is_unit).count(),
            n_damaged: lock(&self.damaged).len(),
            differing: sent.differing.into_iter().collect(),
            offline: link.offline().map(str::to_owned),
        })
    }
}
