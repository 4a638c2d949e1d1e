//! Asking for the turn to make a unit, and giving it back.

use ::clock::lock;
use dataflow::{Digest, Turn};
use depot::{DepotError, Put, PutMode};

use super::{
    Shared,
    turns::{heartbeat_key, machine_of, note_key},
};

impl Shared {
    /// Asks for the turn to make a unit, and leaves a note of it; a depot that does not answer is done without.
    pub(crate) fn turn(&self, fingerprint: &Digest, is_sure: bool) -> Turn {
        if self.is_offline() {
            return Turn::Own;
        }
        let asked = self.ask_for_turn(fingerprint, is_sure);
        asked.unwrap_or(Turn::Own)
    }

    fn ask_for_turn(&self, fingerprint: &Digest, is_sure: bool) -> Result<Turn, DepotError> {
        let link = self.casual.to_write()?;
        self.turns.beat(&self.heartbeats);
        let (key, id) = (note_key(fingerprint), self.turns.id.as_bytes());
        let mode = if is_sure {
            PutMode::Always
        } else {
            PutMode::IfAbsent
        };
        let put = link.put_bytes(&key, id, mode)?;
        if self.index.expect(&self.casual, fingerprint)? {
            if put == Put::New {
                link.remove(&key)?;
            }
            return Ok(Turn::Made);
        }
        if put == Put::There {
            let note = link.read(&key)?.unwrap_or_default();
            let other = String::from_utf8_lossy(&note);
            if note != id && !note.is_empty() && self.turns.is_alive(&self.casual, &other)? {
                return Ok(Turn::Others(machine_of(&other)));
            }
            link.put_bytes(&key, id, PutMode::Always)?;
        }
        lock(&self.turns.held).insert(*fingerprint);
        Ok(Turn::Own)
    }

    /// Gives the turn back of a unit that was not made.
    pub(crate) fn end_turn(&self, fingerprint: &Digest) {
        if self.turns.give_back(fingerprint) {
            // Without heartbeats it means nothing.
            let _gone = self.casual.idle().remove(&note_key(fingerprint));
        }
    }

    /// Removes the notes of this process; what of them stays means nothing without heartbeats.
    pub(crate) fn end_turns(&self) {
        if !self.turns.end() {
            return;
        }
        let link = self.casual.idle();
        let held = std::mem::take(&mut *lock(&self.turns.held));
        for fingerprint in held {
            if link.remove(&note_key(&fingerprint)).is_err() {
                return;
            }
        }
        let _gone = link.remove(&heartbeat_key(&self.turns.id));
    }
}
