//! Small files in the depot by which a run and its workers communicate: orders and their outcomes.

use dataflow::FileRef;
use depot::{Content, PutMode};

use super::keys;
use crate::{LakeError, lake::Lake};

/// Messages between a run and its workers in the depot.
impl Lake {
    /// Leaves a message under a key, e.g. `NAME/orders/7`.
    ///
    /// # Errors
    ///
    /// Fails if the lake has no depot, or that cannot be used.
    pub fn leave_message(&self, key: &str, bytes: Vec<u8>) -> Result<(), LakeError> {
        let link = self.depot()?.remote.to_write()?;
        link.put(
            &keys::message(key),
            Content::of_bytes(bytes),
            PutMode::Always,
        )?;
        Ok(())
    }

    /// Returns the message under a key, if there is one.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn message(&self, key: &str) -> Result<Option<Vec<u8>>, LakeError> {
        Ok(self.depot()?.remote.link().read(&keys::message(key))?)
    }

    /// Lists the keys of the messages below a prefix, in order.
    ///
    /// # Errors
    ///
    /// Fails as [`Lake::leave_message`] does.
    pub fn messages(&self, prefix: &str) -> Result<Vec<String>, LakeError> {
        let found = self.depot()?.remote.link().list(&keys::message(prefix))?;
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
