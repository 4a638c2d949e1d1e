//! Outcomes of commands.

use dataflow::{Diagnostic, Failure, FileError};
use lake::LakeError;

/// A command that ran to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CommandOutcome {
    /// Everything is done: exit code 0.
    Done,
    /// Done, but items were skipped: exit code 3.
    SkippedItems,
    /// With the exit code of the process that was attached to.
    ExitCode(u8),
}

impl CommandOutcome {
    /// Returns the exit code.
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::SkippedItems => 3,
            Self::ExitCode(code) => code,
        }
    }
}

/// A command that failed.
#[derive(Debug)]
pub(crate) enum CommandError {
    /// The pipeline file is wrong: exit code 2.
    File(FileError),
    /// The command line is invalid: exit code 2.
    Usage {
        message: String,
        hint: Option<String>,
    },
    /// Something failed: exit code 1.
    Failed {
        error: anyhow::Error,
        hint: Option<String>,
    },
}

impl From<FileError> for CommandError {
    fn from(err: FileError) -> Self {
        Self::File(err)
    }
}

impl From<Failure> for CommandError {
    fn from(err: Failure) -> Self {
        let hint = err.hint();
        match err {
            Failure::Files(err) => Self::File(err),
            Failure::NoStage { .. } | Failure::NoNode { .. } | Failure::NoPartition { .. } => {
                Self::Usage {
                    message: err.to_string(),
                    hint,
                }
            }
            err => Self::Failed {
                hint,
                error: err.into(),
            },
        }
    }
}

impl From<LakeError> for CommandError {
    fn from(err: LakeError) -> Self {
        let hint = err.hint();
        match err {
            LakeError::NoLake { .. }
            | LakeError::NoRun { .. }
            | LakeError::NoTag { .. }
            | LakeError::InvalidTag { .. } => Self::Usage {
                message: err.to_string(),
                hint,
            },
            err => Self::Failed {
                hint,
                error: err.into(),
            },
        }
    }
}

impl CommandError {
    pub(crate) fn usage(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Usage {
            message: message.into(),
            hint: Some(hint.into()),
        }
    }

    /// Returns a function that adds its hint to an error.
    pub(crate) fn with_hint<E: Into<anyhow::Error>>(
        hint: fn(&E) -> Option<String>,
    ) -> impl Fn(E) -> Self {
        move |err| {
            let hint = hint(&err);
            Self::failed(err, hint)
        }
    }

    pub(crate) fn failed(error: impl Into<anyhow::Error>, hint: Option<String>) -> Self {
        Self::Failed {
            error: error.into(),
            hint,
        }
    }
}
