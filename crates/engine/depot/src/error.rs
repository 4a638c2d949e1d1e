//! Failures of a depot.

use std::{error::Error, io, sync::Arc, time::Duration};

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
    /// The folder of a depot is not there.
    #[error("the depot's folder `{folder}` cannot be used")]
    Folder {
        /// The folder.
        folder: String,
        /// Why not.
        source: io::Error,
    },
    /// A request to a store of another kind failed.
    #[error("cannot {action} `{key}` in the depot")]
    Store {
        /// Operation that failed, e.g. `get`.
        action: &'static str,
        /// The key.
        key: String,
        /// Suggested fix, if the cause is known.
        hint: Option<String>,
        /// Whether it is no matter of time.
        is_lasting: bool,
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
    /// A depot has a layout of another version.
    #[error("the depot's layout is `{found}`, which this version of the program does not know")]
    Layout {
        /// The layout found.
        found: String,
    },
    /// A request failed again and again.
    #[error("the depot was down for {}", in_words(*lasted))]
    Down {
        /// Time since the first failure.
        lasted: Duration,
        /// The last failure.
        source: Box<Self>,
    },
    /// A depot that is offline is not asked again.
    #[error(transparent)]
    Offline(Arc<Self>),
    /// A depot that failed is not asked for a while.
    #[error("the depot is not asked for a while after a failure")]
    Resting,
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

    /// Whether the same request fails later as well.
    pub fn is_lasting(&self) -> bool {
        match self {
            Self::Store { is_lasting, .. } => *is_lasting,
            Self::Unreliable { .. } | Self::Layout { .. } => true,
            Self::Down { source, .. } => source.is_lasting(),
            Self::Offline(err) => err.is_lasting(),
            Self::Io { .. } | Self::Folder { .. } | Self::Silent { .. } | Self::Resting => false,
        }
    }

    /// Returns a suggested fix, if the cause is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Store { hint, .. } => hint.clone(),
            Self::Io { source, .. } => match source.kind() {
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                    Some("free space there, e.g. by `pipeline gc --depot`".to_owned())
                }
                io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => Some(
                    "its folders must be writable by you: `chgrp lab DIR; chmod 2775 DIR`, and `umask 002`"
                        .to_owned(),
                ),
                _ => None,
            },
            Self::Folder { folder, .. } => Some(format!(
                "check that `{folder}` is mounted: `ls {folder}`; a new one must be made first"
            )),
            Self::Down { source, .. } => source.hint(),
            Self::Offline(err) => err.hint(),
            Self::Layout { .. } => {
                Some("use the version of the program that the other machines use".to_owned())
            }
            Self::Silent { .. } | Self::Unreliable { .. } | Self::Resting => None,
        }
    }

    /// Returns the error with its causes, in one line; a cause that the text before it ends in is left out.
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = self.source();
        while let Some(err) = cause {
            let words = err.to_string();
            if !text.ends_with(&words) {
                text.push_str(": ");
                text.push_str(&words);
            }
            cause = err.source();
        }
        text
    }
}

/// A duration in words.
fn in_words(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        _ => format!("{} h", seconds / 3600),
    }
}
