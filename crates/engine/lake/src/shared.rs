//! Sharing of results between a lake and a depot, which several machines use.
//!
//! A lake with a depot finds in it what it does not have: a record is looked up there, and a blob is
//! fetched when something asks for its bytes. What the lake makes is sent there beside the work. A depot that is
//! down is asked again for as long as [`Sharing`] says; bytes are checked as they come.

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
mod turn_requests;
mod turns;

use std::{
    collections::{BTreeSet, HashSet},
    ops::Add,
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    time::{Duration, Instant, SystemTime},
};

use ::clock::lock;
use dataflow::{Digest, FileRef, NodeName, RecordOutcome};
use depot::{Depot, Entry, Outage, OutageListener, Patience, Traffic};

use crate::{LakeError, blobs::Blobs, clock::now, folder::Folder, records::Records};

pub(crate) use self::{index::SharedRun, marks::Item, send::key_of};
use self::{
    index::{FoundRecord, Index},
    marks::{Outbox, RemoteBlobs},
    remote::{Layout, Remote},
    send::Sender,
    turns::Turns,
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
    /// Why the depot is not asked any more, if the lake goes on alone.
    pub offline: Option<String>,
    /// Why results could not be sent at last, if that is so.
    pub unsent: Option<String>,
}

/// How a lake uses its depot.
#[derive(Clone)]
pub struct Sharing {
    /// Time for which a request that one cannot do without is made again.
    pub patience: Duration,
    /// What follows after that.
    pub outage_policy: OutagePolicy,
    /// Receives outages.
    pub on_outage: Option<Arc<DepotOutageListener>>,
}

impl Default for Sharing {
    /// Seconds, and then alone.
    fn default() -> Self {
        Self {
            patience: Duration::from_secs(5),
            outage_policy: OutagePolicy::Alone,
            on_outage: None,
        }
    }
}

/// What follows when a depot stays down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutagePolicy {
    /// An error.
    Fail,
    /// The lake goes on alone: what it lacks is made here.
    Alone,
}

/// An outage of a depot.
#[derive(Debug, Clone)]
pub struct DepotOutage {
    /// When it began, by this machine's clock.
    pub since: SystemTime,
    /// The outage.
    pub outage: Outage,
    /// Whether it is about results that are sent beside the work, for which nothing waits.
    pub is_of_sending: bool,
    /// Units that are being looked up and are not here: their output and their number.
    pub at_stake: Option<(NodeName, usize)>,
}

/// Receives outages of a depot.
pub type DepotOutageListener = dyn Fn(&DepotOutage) + Send + Sync;

/// The units that are being looked up: their output, and those that are not here.
type AtStake = Arc<Mutex<Option<(NodeName, Vec<Digest>)>>>;

/// The depot of a lake, and its known content.
pub(crate) struct Shared {
    /// For what one cannot do without.
    remote: Arc<Remote>,
    /// For what one can do without.
    casual: Remote,
    /// For heartbeats, which must not wait for anything else.
    heartbeats: Arc<Remote>,
    /// For results that are sent beside the work.
    sending: Arc<Remote>,
    turns: Arc<Turns>,
    outage_policy: OutagePolicy,
    at_stake: AtStake,
    folder: Folder,
    index: Index,
    pub(crate) outbox: Outbox,
    pub(crate) unfetched: RemoteBlobs,
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
    pub(crate) fn new(depot: &Arc<dyn Depot>, folder: &Folder, sharing: &Sharing) -> Self {
        let layout = Arc::new(Layout::default());
        let at_stake = AtStake::default();
        let listener = |is_of_sending: bool| -> Option<Arc<OutageListener>> {
            let listener = sharing.on_outage.clone()?;
            let (at_stake, records) = (Arc::clone(&at_stake), Records::new(folder.clone()));
            Some(Arc::new(move |outage: &Outage| {
                let at_stake = lock(&at_stake);
                let at_stake = at_stake.as_ref().filter(|_| !is_of_sending);
                let is_absent = |unit: &&Digest| !records.path(unit).exists();
                listener(&DepotOutage {
                    since: now().checked_sub(outage.lasted).unwrap_or_else(now),
                    outage: outage.clone(),
                    is_of_sending,
                    at_stake: at_stake.map(|(node, units)| {
                        (node.clone(), units.iter().filter(is_absent).count())
                    }),
                });
            }))
        };
        let link = |patience, listener| Remote::new(depot, &layout, patience, listener);
        let sending = Arc::new(link(Patience::ENDLESS, listener(true)));
        let lost = Arc::default();
        let turns = Arc::new(Turns::default());
        Self {
            sender: Sender::new(
                Arc::clone(&sending),
                folder,
                Arc::clone(&lost),
                Arc::clone(&turns),
            ),
            remote: Arc::new(link(Patience::For(sharing.patience), listener(false))),
            casual: link(Patience::Casual, None),
            heartbeats: Arc::new(link(Patience::Once, None)),
            turns,
            sending,
            outage_policy: sharing.outage_policy,
            at_stake,
            folder: folder.clone(),
            index: Index::default(),
            outbox: Outbox::new(folder),
            unfetched: RemoteBlobs::new(folder),
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

    /// Notes which units of an output are looked up next, so that an outage says what is at stake.
    pub(crate) fn look_ahead(&self, node: &NodeName, units: Vec<Digest>) {
        *lock(&self.at_stake) = Some((node.clone(), units));
    }

    /// Asks for the record of a unit that another machine has just made.
    pub(crate) fn expect(&self, fingerprint: &Digest) -> Result<bool, LakeError> {
        let there = self.index.expect(&self.remote, fingerprint);
        self.or_alone(there.map_err(Into::into))
    }

    /// Returns an answer of the depot, or that of an empty one where it is down and the lake goes on alone.
    fn or_alone<T: Default>(&self, answer: Result<T, LakeError>) -> Result<T, LakeError> {
        match answer {
            Err(LakeError::Depot(_)) if self.outage_policy == OutagePolicy::Alone => {
                Ok(T::default())
            }
            answer => answer,
        }
    }

    /// Returns when the depot failed last, if it did.
    pub(crate) fn last_failure(&self) -> Option<Instant> {
        let links = [&self.remote, &self.heartbeats, &self.sending];
        links
            .into_iter()
            .filter_map(|it| it.idle().last_failure())
            .max()
    }

    /// Marks files to be sent again, of which the depot may have lost some.
    pub(crate) fn mark_suspect<'f>(&self, files: impl Iterator<Item = &'f FileRef>) {
        lock(&self.lost).extend(files.map(|file| file.digest));
    }

    /// Sends a file that the depot lacks; returns whether it is there now.
    pub(crate) fn offer(&self, file: &FileRef) -> Result<bool, LakeError> {
        self.sender.offer(&self.remote, file)
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

    /// Whether it is not asked any more, or does not take results now.
    pub(crate) fn is_down(&self) -> bool {
        self.is_offline() || self.sending.idle().failing().is_some()
    }

    /// Returns a result from the depot, whose files can be fetched.
    pub(crate) fn lookup(
        &self,
        records: &Records,
        blobs: &Blobs,
        fingerprint: &Digest,
    ) -> Result<Option<Arc<RecordOutcome>>, LakeError> {
        let found = self.index.record(&self.remote, records, fingerprint);
        let Some((stored, recipe)) = self.or_alone(found)? else {
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
        Ok(Index::fingerprints(&self.remote)?)
    }

    /// Lists the files below a prefix.
    pub(crate) fn list(&self, prefix: &str) -> Result<Vec<Entry>, LakeError> {
        Ok(self.remote.list(prefix)?)
    }

    /// Returns a small file, if there is one.
    pub(crate) fn read(&self, key: &str) -> Result<Option<Vec<u8>>, LakeError> {
        Ok(self.remote.read(key)?)
    }

    /// The error of a depot that is not asked any more, if it is not.
    pub(crate) fn offline(&self) -> Option<LakeError> {
        self.remote.link().err().map(Into::into)
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

    /// Waits until everything is sent, for `patience`, or for `longest_down` where the depot is down.
    pub(crate) fn finish(
        &self,
        patience: Duration,
        longest_down: Duration,
    ) -> Result<(), LakeError> {
        if !self.outbox.list()?.is_empty() {
            self.sender.finish(patience, longest_down);
        }
        Ok(())
    }

    pub(crate) fn report(&self) -> Result<SharingReport, LakeError> {
        let links = [
            &*self.remote,
            &self.casual,
            &self.heartbeats,
            &*self.sending,
        ];
        let traffic = links.map(|it| it.idle().traffic());
        let sent = self.sender.sent();
        let waiting = self.outbox.list()?;
        let is_unit = |item: &&Item| matches!(item, Item::Unit(_));
        Ok(SharingReport {
            traffic: traffic.into_iter().fold(Traffic::default(), Add::add),
            n_units_found: self.n_found.load(Ordering::Relaxed),
            n_files_fetched: self.n_fetched.load(Ordering::Relaxed),
            n_units_sent: sent.n_units,
            n_units_damaged: sent.n_damaged,
            n_units_waiting: waiting.iter().filter(is_unit).count(),
            n_damaged: lock(&self.damaged).len(),
            differing: sent.differing.into_iter().collect(),
            // Where it is not gone on alone, that is an error.
            offline: self
                .remote
                .idle()
                .offline()
                .filter(|_| self.outage_policy == OutagePolicy::Alone),
            unsent: self.sending.idle().failing(),
        })
    }
}
