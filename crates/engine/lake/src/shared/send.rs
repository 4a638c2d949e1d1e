//! Sending results to the depot, beside the work.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::{self, Read},
    path::Path,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Duration, SystemTime},
};

use ::clock::{Condvar, lock};
use dataflow::{Digest, FileRef};
use depot::{Content, DepotError, Entry, PutMode};

use super::marks::{Item, Outbox};
use super::turns::{Turns, forget};
use super::{index::SharedRun, keys, remote::Remote};
use crate::{
    LakeError, atomic,
    blobs::Blobs,
    clock::now,
    folder::Folder,
    lock::Locks,
    records::{Records, Stored},
    register::{Register, Run},
    sealed,
};

/// Items sent at once.
const AT_ONCE: usize = 8;

/// Time between looks for items that other processes have put into the outbox.
const EVERY: Duration = Duration::from_millis(500);

/// Age from which a blob that is there is sent again, so that garbage collection, which removes
/// unreferenced blobs much older, sees that it is in use.
const RENEWED: Duration = Duration::from_hours(24);

/// Why an item was not sent.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SendFailure {
    /// The depot is offline.
    #[error(transparent)]
    Depot(#[from] DepotError),
    /// The lake could not be read.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

/// Result of sending.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct SendReport {
    /// Number of units.
    pub(crate) n_units: usize,
    /// Number of units that have a file missing or damaged here.
    pub(crate) n_damaged: usize,
    /// Units, as `stage` and partition, that the depot holds with other files, and the machine that
    /// made those.
    pub(crate) differing: BTreeSet<(String, String)>,
}

/// Sends the items in the outbox, in a thread that is started by the first to ask for it.
pub(crate) struct Sender {
    work: Arc<Work>,
    is_started: Mutex<bool>,
}

struct Work {
    remote: Arc<Remote>,
    outbox: Outbox,
    records: Records,
    blobs: Blobs,
    locks: Locks,
    register: Register,
    /// Blobs that this process has sent or seen in the depot.
    there: Mutex<BTreeSet<Digest>>,
    /// Blobs that the depot has lost or damaged.
    lost: Arc<Mutex<BTreeSet<Digest>>>,
    /// Notes of units that are being made.
    turns: Arc<Turns>,
    sent: Mutex<SendReport>,
    passes: Mutex<Passes>,
    changed: Condvar,
}

/// Passes through the outbox.
#[derive(Default)]
struct Passes {
    /// Passes asked for.
    n_asked: usize,
    /// Passes done that were asked for.
    n_done: usize,
}

impl Sender {
    pub(crate) fn new(
        remote: Arc<Remote>,
        folder: &Folder,
        lost: Arc<Mutex<BTreeSet<Digest>>>,
        turns: Arc<Turns>,
    ) -> Self {
        let work = Work {
            remote,
            outbox: Outbox::new(folder),
            records: Records::new(folder.clone()),
            blobs: Blobs::new(folder.clone()),
            locks: Locks::new(folder.locks()),
            register: Register::new(folder.clone()),
            there: Mutex::default(),
            lost,
            turns,
            sent: Mutex::default(),
            passes: Mutex::default(),
            changed: Condvar::default(),
        };
        Self {
            work: Arc::new(work),
            is_started: Mutex::new(false),
        }
    }

    /// Begins to send.
    pub(crate) fn start(&self) {
        let mut is_started = lock(&self.is_started);
        if !*is_started {
            *is_started = true;
            let work = Arc::clone(&self.work);
            ::clock::spawn(move || work.go_on());
        }
    }

    /// Waits until everything that is complete is sent, for `patience`, or for `longest_down` where the depot is down.
    pub(crate) fn finish(&self, patience: Duration, longest_down: Duration) {
        self.start();
        let began = ::clock::now();
        let until = began + patience;
        self.work.remote.idle().retry_now();
        let mut passes = lock(&self.work.passes);
        passes.n_asked += 1;
        let asked = passes.n_asked;
        self.work.changed.notify_all();
        while passes.n_done < asked {
            let left = until.saturating_duration_since(::clock::now());
            let link = self.work.remote.idle();
            let is_down = || {
                let is_silent = link.succeeded().is_none_or(|last| last < began);
                let is_long = link.down_for().is_some_and(|down| down > longest_down);
                (is_silent || is_long) && ::clock::since(began) > longest_down
            };
            if left.is_zero() || is_down() {
                return;
            }
            let work = &self.work;
            passes = work
                .changed
                .wait_timeout(passes, &work.passes, left.min(EVERY));
        }
    }

    /// Sends a file that the depot lacks, by this link; returns whether it is there now.
    pub(crate) fn offer(&self, remote: &Remote, file: &FileRef) -> Result<bool, LakeError> {
        self.work.send_blob(remote, file).map_err(|err| match err {
            SendFailure::Depot(err) => err.into(),
            SendFailure::Lake(err) => err,
        })
    }

    pub(crate) fn sent(&self) -> SendReport {
        lock(&self.work.sent).clone()
    }
}

impl Work {
    /// Passes through the outbox until the process ends or the depot is offline.
    fn go_on(&self) {
        loop {
            let asked = lock(&self.passes).n_asked;
            // Items that cannot be read now are tried again in the next pass.
            let _tried = self.outbox.list().map(|items| self.pass(&items));
            let is_offline = self.remote.idle().offline().is_some();
            let mut passes = lock(&self.passes);
            passes.n_done = if is_offline { usize::MAX } else { asked };
            self.changed.notify_all();
            if is_offline {
                return;
            }
            if passes.n_asked == asked {
                let waited = self.changed.wait_timeout(passes, &self.passes, EVERY);
                drop(waited);
            }
        }
    }

    /// Sends units, then the runs that refer to them, one after the other: the last is the newest.
    fn pass(&self, items: &[Item]) {
        let (units, mut runs): (Vec<Item>, Vec<Item>) =
            items.iter().partition(|item| matches!(item, Item::Unit(_)));
        let ordered = self.register.ordered().unwrap_or_default();
        runs.sort_by_key(|run| match run {
            Item::Run(number) => ordered.iter().position(|known| known == number),
            Item::Unit(_) => None,
        });
        for (items, at_once) in [(units, AT_ONCE), (runs, 1)] {
            let next = AtomicUsize::new(0);
            let send = || {
                while let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if self.send(*item).is_err() && self.remote.idle().offline().is_some() {
                        return;
                    }
                }
            };
            ::clock::all(items.len().min(at_once), send);
        }
    }

    fn send(&self, item: Item) -> Result<(), SendFailure> {
        match item {
            Item::Unit(fingerprint) => self.send_unit(&fingerprint),
            Item::Run(number) => self.send_run(number),
        }
    }

    fn send_unit(&self, fingerprint: &Digest) -> Result<(), SendFailure> {
        let item = Item::Unit(*fingerprint);
        let Some(stored) = self.records.read(fingerprint)? else {
            // A unit in the making is marked before its record is stored.
            let lock = self.locks.try_take(&fingerprint.to_hex(), "nothing")?;
            if lock.is_some() && self.records.read(fingerprint)?.is_none() {
                self.outbox.remove(item)?;
            }
            return Ok(());
        };
        for file in stored
            .outcome
            .files()
            .into_iter()
            .flat_map(|files| files.values())
        {
            if !self.send_blob(&self.remote, file)? {
                // It is not here whole, so that its unit will be made again, unless it was collected meanwhile.
                let is_collected = self.records.read(fingerprint)?.is_none();
                lock(&self.sent).n_damaged += usize::from(!is_collected);
                return Ok(self.outbox.remove(item)?);
            }
        }
        self.send_recipe(&stored.recipe)?;
        let path = self.records.path(fingerprint);
        let bytes = sealed::seal(&path, &stored)?;
        if let Some(there) = self.remote.create(&keys::record(fingerprint), &bytes)? {
            self.compare(&stored, &bytes, &there)?;
        }
        lock(&self.sent).n_units += 1;
        self.outbox.remove(item)?;
        forget(&self.turns, &self.remote, fingerprint);
        Ok(())
    }

    /// Compares a record with the one that was there first. Of two that differ the first stays; one
    /// that is damaged is replaced.
    fn compare(&self, stored: &Stored, bytes: &[u8], there: &[u8]) -> Result<(), SendFailure> {
        let fingerprint = &stored.fingerprint;
        let key = keys::record(fingerprint);
        let first: Option<Stored> = sealed::parse(Path::new(&key), there).ok();
        let Some(first) = first.filter(|first| first.fingerprint == *fingerprint) else {
            let link = self.remote.to_write()?;
            link.put_bytes(&key, bytes, PutMode::Always)?;
            return Ok(());
        };
        if first.outcome == stored.outcome {
            return Ok(());
        }
        let unit = format!("{} `{}`", stored.stage, stored.partition);
        let differing = (unit, first.provenance.host);
        lock(&self.sent).differing.insert(differing);
        let key = keys::differing(fingerprint, &atomic::process_name());
        let link = self.remote.to_write()?;
        link.put_bytes(&key, bytes, PutMode::Always)?;
        Ok(())
    }

    fn send_recipe(&self, digest: &Digest) -> Result<(), SendFailure> {
        if lock(&self.there).contains(digest) {
            return Ok(());
        }
        if let Some(recipe) = self.records.recipe(digest)? {
            let key = keys::recipe(digest);
            let bytes = sealed::seal(Path::new(&key), &recipe)?;
            let link = self.remote.to_write()?;
            let there = link.head(&key)?;
            let is_whole = |it: &Entry| it.size == bytes.len() as u64 && is_recent(it.modified);
            if !there.is_some_and(|it| is_whole(&it)) {
                link.put_bytes(&key, &bytes, PutMode::Always)?;
            }
            lock(&self.there).insert(*digest);
        }
        Ok(())
    }

    /// Sends a blob, unless it is there; returns whether it is there now.
    fn send_blob(&self, remote: &Remote, file: &FileRef) -> Result<bool, SendFailure> {
        let digest = &file.digest;
        let is_lost = lock(&self.lost).contains(digest);
        if lock(&self.there).contains(digest) && !is_lost {
            return Ok(true);
        }
        let key = keys::blob(digest);
        let link = remote.to_write()?;
        let there = if is_lost { None } else { link.head(&key)? };
        let there = there.filter(|it| it.size == file.size);
        if there.as_ref().is_some_and(|it| is_recent(it.modified)) {
            lock(&self.there).insert(*digest);
            return Ok(true);
        }
        let path = self.blobs.path(digest);
        match atomic::open(&path) {
            Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(there.is_some()),
            opened => opened.map_err(atomic::io_error("read", &path))?,
        };
        let is_damaged = Arc::new(AtomicBool::new(false));
        let open = || {
            let opened = atomic::open(&path)?;
            Ok(Content {
                size: file.size,
                reader: Box::new(VerifiedBytes::new(opened, file, &is_damaged)),
            })
        };
        match link.put(&key, &open, PutMode::Always) {
            Ok(_) => {}
            Err(_) if is_damaged.load(Ordering::Relaxed) => return Ok(false),
            Err(err) => return Err(err.into()),
        }
        lock(&self.there).insert(*digest);
        lock(&self.lost).remove(digest);
        Ok(true)
    }

    /// Sends the records of a run's units in one file, once all of them are there.
    fn send_run(&self, number: u64) -> Result<(), SendFailure> {
        let item = Item::Run(number);
        let Ok(mut run) = self.register.read(number) else {
            return Ok(self.outbox.remove(item)?);
        };
        let waiting = self.outbox.list()?;
        let (mut units, mut recipes) = (Vec::new(), BTreeMap::new());
        let mut made_now = Vec::new();
        for unit in self.register.units(&run)? {
            if waiting.contains(&Item::Unit(unit.fingerprint)) {
                return Ok(());
            }
            let Some(stored) = self.records.read(&unit.fingerprint)? else {
                continue;
            };
            if !recipes.contains_key(&stored.recipe)
                && let Some(recipe) = self.records.recipe(&stored.recipe)?
            {
                recipes.insert(stored.recipe, recipe);
            }
            if unit.made_now {
                made_now.push(units.len());
            }
            units.push(stored);
        }
        let key = key_of(&run);
        run.manifest = None;
        run.history = BTreeMap::new();
        run.made_now = made_now;
        let shared = SharedRun {
            pipeline: run.record.pipeline.clone(),
            run: Some(run),
            units,
            recipes,
        };
        let bytes = sealed::seal(Path::new(&key), &shared)?;
        let link = self.remote.to_write()?;
        link.put_bytes(&key, &bytes, PutMode::Always)?;
        Ok(self.outbox.remove(item)?)
    }
}

/// Key of a run.
pub(crate) fn key_of(run: &Run) -> String {
    let name = format!("{:020}-{}", run.started_ns, run.process);
    keys::run(&run.record.pipeline, &name)
}

/// Whether a blob was stored so lately that it is safe from collection. Clocks that differ by hours
/// make no difference.
fn is_recent(modified: SystemTime) -> bool {
    now()
        .duration_since(modified)
        .is_ok_and(|age| age < RENEWED)
}

/// The bytes of a blob, which end in an error if they are not those of its digest: then nothing is
/// stored.
struct VerifiedBytes {
    file: File,
    hasher: blake3::Hasher,
    expected: Digest,
    left: u64,
    /// Set where they are not.
    is_damaged: Arc<AtomicBool>,
}

impl VerifiedBytes {
    fn new(file: File, expected: &FileRef, is_damaged: &Arc<AtomicBool>) -> Self {
        Self {
            is_damaged: Arc::clone(is_damaged),
            file,
            hasher: blake3::Hasher::new(),
            expected: expected.digest,
            left: expected.size,
        }
    }
}

impl VerifiedBytes {
    fn read_checked(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let n_read = self.file.read(into)?;
        self.hasher.update(into.get(..n_read).unwrap_or_default());
        let left = self.left.checked_sub(n_read as u64);
        self.left = left.ok_or_else(damaged)?;
        // The reader may stop at the blob's size, so the digest is checked there.
        if self.left == 0 && Digest::from(*self.hasher.finalize().as_bytes()) != self.expected {
            return Err(damaged());
        }
        if n_read == 0 && self.left > 0 && !into.is_empty() {
            return Err(damaged());
        }
        Ok(n_read)
    }
}

impl Read for VerifiedBytes {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.read_checked(into);
        self.is_damaged.fetch_or(read.is_err(), Ordering::Relaxed);
        read
    }
}

fn damaged() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        "its bytes are not those of its digest",
    )
}
