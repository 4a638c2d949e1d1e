//! Turns of machines that make the same units at once: each leaves a note of what it makes now, with a heartbeat, and
//! the others take that last.
//!
//! It saves work and guards nothing: where a note is missed, a unit is made twice, with equal bytes.

use std::{
    collections::{BTreeSet, HashMap},
    path::Path,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use ::clock::lock;
use dataflow::Digest;
use depot::{DepotError, PutMode};

use super::{keys, remote::Remote};
use crate::atomic;

/// Time between two heartbeats of a process that makes units.
const PERIOD: Duration = Duration::from_secs(5);

/// Time without a new heartbeat after which a process counts as dead.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Time for which a heartbeat that was read is not read again.
const READ_AGAIN: Duration = Duration::from_secs(1);

/// The turns of this process, and what is known of those of others.
pub(crate) struct Turns {
    /// Name of this process in its notes.
    pub(super) id: String,
    /// Units of which this process has left a note.
    pub(super) held: Mutex<BTreeSet<Digest>>,
    others: Mutex<HashMap<String, Heartbeat>>,
    /// Set when this process makes no more units; held while a heartbeat is left, so that none appears after the end.
    is_over: Arc<Mutex<bool>>,
    /// Whether it leaves heartbeats.
    is_beating: Mutex<bool>,
}

/// The last heartbeat of another process.
struct Heartbeat {
    bytes: Option<Vec<u8>>,
    /// When it was first seen, and when it was read last.
    since: Instant,
    read: Instant,
}

impl Default for Turns {
    fn default() -> Self {
        Self {
            id: atomic::process_name(),
            held: Mutex::default(),
            others: Mutex::default(),
            is_over: Arc::default(),
            is_beating: Mutex::default(),
        }
    }
}

pub(super) fn note_key(fingerprint: &Digest) -> String {
    keys::message(&format!("making/{fingerprint}"))
}

pub(super) fn heartbeat_key(id: &str) -> String {
    keys::message(&format!("makers/{id}"))
}

/// The machine in the name of a process.
pub(super) fn machine_of(id: &str) -> String {
    id.splitn(3, '-').nth(2).unwrap_or(id).to_owned()
}

impl Turns {
    /// Whether this process has left a note of a unit; it forgets that.
    pub(crate) fn give_back(&self, fingerprint: &Digest) -> bool {
        lock(&self.held).remove(fingerprint)
    }

    /// Ends the heartbeats; returns whether there were any.
    pub(super) fn end(&self) -> bool {
        *lock(&self.is_beating) && !std::mem::replace(&mut *lock(&self.is_over), true)
    }

    /// Leaves heartbeats from now on, the first at once.
    pub(super) fn beat(&self, heartbeats: &Arc<Remote>) {
        // Other threads wait for the first one: a note without it means nothing.
        let mut is_beating = lock(&self.is_beating);
        if *is_beating {
            return;
        }
        *is_beating = true;
        let key = heartbeat_key(&self.id);
        let leave = move |heartbeats: &Remote, n: u64| {
            let link = heartbeats.to_write()?;
            link.put_bytes(&key, n.to_string().as_bytes(), PutMode::Always)
        };
        // One that is missed is followed by others.
        let _left = leave(heartbeats, 0);
        let (heartbeats, is_over) = (Arc::clone(heartbeats), Arc::clone(&self.is_over));
        ::clock::spawn(move || {
            for n in 1.. {
                ::clock::sleep(PERIOD);
                let is_over = lock(&is_over);
                if *is_over {
                    return;
                }
                let _left = leave(&heartbeats, n);
            }
        });
    }

    /// Whether a process that left a note is alive, as far as its heartbeats tell; of this machine it is known.
    pub(super) fn is_alive(&self, remote: &Remote, id: &str) -> Result<bool, DepotError> {
        let process = id.split('-').next().unwrap_or_default();
        let is_here = machine_of(id) == machine_of(&self.id);
        if is_here && !Path::new("/proc").join(process).exists() {
            return Ok(false);
        }
        let mut others = lock(&self.others);
        let now = ::clock::now();
        let known = others.get(id);
        if known.is_none_or(|it| now - it.read > READ_AGAIN) {
            let bytes = remote.read(&heartbeat_key(id))?;
            let known = others.entry(id.to_owned());
            let known = known.or_insert_with(|| Heartbeat {
                bytes: bytes.clone(),
                since: now,
                read: now,
            });
            known.read = now;
            if known.bytes != bytes {
                (known.bytes, known.since) = (bytes, now);
            }
        }
        let known = others.get(id);
        Ok(known.is_some_and(|it| it.bytes.is_some() && now - it.since < TIMEOUT))
    }
}

/// Removes the note of a unit whose record is in the depot.
pub(crate) fn forget(turns: &Turns, remote: &Remote, fingerprint: &Digest) {
    if turns.give_back(fingerprint) {
        // It means nothing beside a record.
        let _gone = remote.idle().remove(&note_key(fingerprint));
    }
}
