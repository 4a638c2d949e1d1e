//! Small files in the depot by which a run and its workers communicate: work items and their outcomes.

use std::time::Duration;

use dataflow::FileRef;
use depot::PutMode;

use super::{Shared, keys};
use crate::{LakeError, lake::Lake};

/// Messages between a run and its workers in the depot.
impl Lake {
    /// Leaves a message under a key, e.g. `NAME/orders/7`.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, or that cannot be used.
    pub fn leave_message(&self, key: &str, bytes: &[u8]) -> Result<(), LakeError> {
        let link = self.depot()?.remote.to_write()?;
        link.put_bytes(&keys::message(key), bytes, PutMode::Always)?;
        Ok(())
    }

    /// Leaves a heartbeat under a key: on a link of its own, and without a second try, since another follows.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn leave_heartbeat(&self, key: &str, bytes: &[u8]) -> Result<(), LakeError> {
        let link = self.depot()?.heartbeats.to_write()?;
        link.put_bytes(&keys::message(key), bytes, PutMode::Always)?;
        Ok(())
    }

    /// Returns the time since the depot failed last, if it ever did: what has not been heard of in it since then may
    /// still be alive.
    pub fn time_since_failure(&self) -> Option<Duration> {
        let last_failure = self.shared.as_ref().and_then(Shared::last_failure);
        last_failure.map(::clock::since)
    }

    /// Returns the message under a key, if there is one.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn message(&self, key: &str) -> Result<Option<Vec<u8>>, LakeError> {
        Ok(self.depot()?.remote.read(&keys::message(key))?)
    }

    /// Lists the keys of the messages below a prefix, in order.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn messages(&self, prefix: &str) -> Result<Vec<String>, LakeError> {
        let found = self.depot()?.remote.list(&keys::message(prefix))?;
        let below = format!("{}/", keys::MESSAGES);
        let keys = found.iter().filter_map(|it| it.key.strip_prefix(&below));
        let mut keys: Vec<String> = keys.map(str::to_owned).collect();
        keys.sort();
        Ok(keys)
    }

    /// Removes the message under a key, if there is one.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn remove_message(&self, key: &str) -> Result<(), LakeError> {
        Ok(self
            .depot()?
            .remote
            .to_write()?
            .remove(&keys::message(key))?)
    }

    /// Sends a file that the depot lacks; returns whether it is there now.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn offer(&self, file: &FileRef) -> Result<bool, LakeError> {
        self.depot()?.offer(file)
    }
}
