//! A depot in memory, whose answers are late, lost, cut and refused while a fault lasts.

use std::{
    collections::BTreeMap,
    io,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, SystemTime},
};

use clock::{lock, random};
use depot::{Content, Depot, DepotError, Entry, Put, PutMode, Sink};
use serde_json::Value;

use super::{Old, below, seen::Seen};

/// Longest time of an answer, in milliseconds, and of one while answers are slow.
const ANSWER_MS: u64 = 60;
const SLOW_MS: u64 = 6_000;

/// What happens to requests for a while.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// They fail: a folder that is away, a store that is down.
    Fails,
    /// They are never answered, and have an effect or none.
    Hangs,
    /// They have an effect, and the answer is lost.
    Lost,
    /// Lists and files end in the middle.
    Cut,
    /// They take seconds.
    Slow,
    /// Nothing can be stored: a full disk.
    Full,
}

/// A fault, when it is there, whom it meets, and how many of a hundred requests.
#[derive(Debug, Clone)]
pub(super) struct Trouble {
    pub(super) fault: Fault,
    pub(super) from: Duration,
    pub(super) to: Duration,
    /// One machine, or all.
    pub(super) machine: Option<String>,
    pub(super) percent: u64,
}

/// Files by key, each with the time at which it was stored.
type Files = BTreeMap<String, (Vec<u8>, SystemTime)>;

/// A depot in memory.
pub(super) struct SimulatedDepot {
    pub(super) seen: Arc<Seen>,
    pub(super) troubles: Vec<Trouble>,
    pub(super) old: Old,
    pub(super) files: Mutex<Files>,
}

impl SimulatedDepot {
    /// The fault that a request meets now.
    fn fault(&self, is_put: bool) -> Option<Fault> {
        let (now, machine) = (self.seen.time(), clock::machine());
        let mut troubles = self.troubles.iter();
        let met = troubles.find(|it| {
            let is_one = it.machine.is_none() || it.machine == machine;
            is_one && (it.from..it.to).contains(&now)
        })?;
        let is_met = below(100) < met.percent && (met.fault != Fault::Full || is_put);
        is_met.then_some(met.fault)
    }

    /// Answers a request by what `work` does with the files, which is told whether to stop in the middle.
    fn answer<R>(
        &self,
        action: &'static str,
        key: &str,
        work: impl FnOnce(&mut Files, bool) -> R,
    ) -> Result<R, DepotError> {
        let fails = |why: &str| DepotError::Io {
            action,
            key: key.to_owned(),
            source: io::Error::other(why.to_owned()),
        };
        let wait = || clock::answer_after(Duration::from_millis(below(ANSWER_MS / 2)));
        if self.old == Old::LooksUpOnce && key.starts_with("messages/making") {
            // Whose turn it is cannot be asked.
            return Err(fails("unknown"));
        }
        let fault = self.fault(action == "put");
        if let Some(fault) = fault {
            self.seen.fault(&format!("{fault:?} {action} {key}"));
        }
        wait();
        let has_effect = match fault {
            Some(Fault::Fails | Fault::Full) => false,
            Some(Fault::Hangs) => random() & 1 == 0,
            Some(Fault::Lost | Fault::Cut | Fault::Slow) | None => true,
        };
        let done = has_effect.then(|| work(&mut lock(&self.files), fault == Some(Fault::Cut)));
        match (fault, done) {
            (Some(Fault::Slow), Some(done)) => {
                clock::answer_after(Duration::from_millis(below(SLOW_MS)));
                self.seen.fault("ends");
                Ok(done)
            }
            (None, Some(done)) => {
                wait();
                Ok(done)
            }
            (Some(Fault::Hangs), _) => {
                clock::answer_after(Duration::from_hours(1));
                self.seen.fault("ends");
                Err(fails("nobody waits for this"))
            }
            _ => Err(fails("as it was to be")),
        }
    }

    /// Notes that a record is there.
    fn note(&self, key: &str, bytes: &[u8]) {
        if key.starts_with("units/") {
            let record: Value = serde_json::from_slice(bytes).unwrap();
            let word = |name: &str| record["body"][name].as_str().unwrap().to_owned();
            self.seen
                .visible(&format!("{}/{}", word("stage"), word("partition")));
        }
    }
}

impl Depot for SimulatedDepot {
    fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError> {
        let (mut passed, mut is_there) = (Ok(()), false);
        let got = self.answer("get", key, |files, is_cut| {
            if let Some((bytes, _)) = files.get(key) {
                let n_bytes = if is_cut { bytes.len() / 2 } else { bytes.len() };
                passed = sink(&bytes[..n_bytes]);
                is_there = true;
            }
        });
        passed.map_err(|source| DepotError::Io {
            action: "get",
            key: key.to_owned(),
            source,
        })?;
        got.map(|()| is_there)
    }

    fn put(&self, key: &str, mut content: Content, mode: PutMode) -> Result<Put, DepotError> {
        let mut bytes = Vec::new();
        let read = content.reader.read_to_end(&mut bytes);
        read.map_err(|source| DepotError::Io {
            action: "put",
            key: key.to_owned(),
            source,
        })?;
        self.answer("put", key, |files, _| {
            if mode == PutMode::IfAbsent && files.contains_key(key) {
                return Put::There;
            }
            self.note(key, &bytes);
            files.insert(key.to_owned(), (bytes, clock::wall()));
            Put::New
        })
    }

    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        self.answer("look for", key, |files, _| entry(files, key))
    }

    fn list(&self, prefix: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
        let below = format!("{prefix}/");
        self.answer("list", prefix, |files, is_cut| {
            let keys = files.keys().filter(|key| key.starts_with(&below));
            let keys: Vec<&String> = keys.collect();
            let n_keys = if is_cut { keys.len() / 2 } else { keys.len() };
            keys[..n_keys]
                .iter()
                .filter_map(|key| entry(files, key))
                .for_each(each);
        })
    }

    fn remove(&self, key: &str) -> Result<(), DepotError> {
        self.answer("remove", key, |files, _| drop(files.remove(key)))
    }
}

fn entry(files: &Files, key: &str) -> Option<Entry> {
    let (bytes, modified) = files.get(key)?;
    Some(Entry {
        key: key.to_owned(),
        size: bytes.len() as u64,
        modified: *modified,
    })
}

/// A depot as the one link of old saw it, on which heartbeats went too: offline for good after one request that fails.
pub(super) struct OfflineAfterOne {
    pub(super) depot: Arc<dyn Depot>,
    pub(super) is_offline: AtomicBool,
}

impl OfflineAfterOne {
    fn ask<R>(
        &self,
        ask: impl FnOnce(&dyn Depot) -> Result<R, DepotError>,
    ) -> Result<R, DepotError> {
        if self.is_offline.load(Ordering::Relaxed) {
            return Err(DepotError::Unreliable {
                why: "a request failed before".to_owned(),
            });
        }
        let answer = ask(&*self.depot);
        self.is_offline.fetch_or(answer.is_err(), Ordering::Relaxed);
        answer
    }
}

impl Depot for OfflineAfterOne {
    fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError> {
        self.ask(|depot| depot.get(key, sink))
    }

    fn put(&self, key: &str, content: Content, mode: PutMode) -> Result<Put, DepotError> {
        self.ask(|depot| depot.put(key, content, mode))
    }

    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        self.ask(|depot| depot.head(key))
    }

    fn list(&self, prefix: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
        self.ask(|depot| depot.list(prefix, each))
    }

    fn remove(&self, key: &str) -> Result<(), DepotError> {
        self.ask(|depot| depot.remove(key))
    }
}
