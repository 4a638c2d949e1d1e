//! Failures of a depot.

use std::{error::Error, io, time::Duration};

/// Failures of a depot.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DepotError {
    /// A file or folder of a shared folder could not be used.
    #[error("cannot {action} `{key}` in the depot")]
    Io {
        /// Operation that failed, e.g. `get`.
        action: &'static str,
        /// The key.
        key: String,
        /// Why it failed.
        source: io::Error,
    },
    /// A request to a store of another kind failed.
    #[error("cannot {action} `{key}` in the depot")]
    Store {
        /// Operation that failed, e.g. `get`.
        action: &'static str,
        /// The key.
        key: String,
        /// Why it failed.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A request was not answered.
    #[error("the depot did not answer within {} s: {action} `{key}`", waited.as_secs())]
    Silent {
        /// Operation that failed, e.g. `get`.
        action: &'static str,
        /// The key.
        key: String,
        /// Time waited without any progress.
        waited: Duration,
    },
    /// A depot answers, but violates its contract.
    #[error("the depot cannot be relied on: {why}")]
    Unreliable {
        /// Behavior that violates the contract.
        why: String,
    },
    /// A depot that failed before is not asked again by this process.
    #[error("the depot is not asked any more: {why}")]
    Offline {
        /// The first failure.
        why: String,
    },
}

impl DepotError {
    /// Returns a function that adds the action and the key to a system's error.
    pub(crate) fn io(action: &'static str, key: &str) -> impl FnOnce(io::Error) -> Self {
        let key = key.to_owned();
        move |source| Self::Io {
            action,
            key,
            source,
        }
    }

    /// Returns the error with its causes, in one line.
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = self.source();
        while let Some(err) = cause {
            text.push_str(": ");
            text.push_str(&err.to_string());
            cause = err.source();
        }
        text
    }
}
