//! Why demonstrations could not be carried over.

use dataflow::{Diagnostic, UnknownPartition};
use lake::LakeError;
use motion::MotionError;

/// Why demonstrations could not be carried over.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// A name in the configuration is no object.
    #[error("there is no object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// There are no demonstrations.
    #[error("there are no trajectories")]
    NoTrajectories,
    /// An object has no points or no resting orientation.
    #[error("object `{object}` has no {lacks}")]
    Incomplete {
        /// The object.
        object: String,
        /// The missing property.
        lacks: &'static str,
    },
    /// The trajectories are of hands with different joints.
    #[error("trajectories `{first}` and `{second}` are of different hands")]
    DifferentHands {
        /// A sequence.
        first: String,
        /// A sequence whose hand has other joints.
        second: String,
    },
    /// A motion has rates that are no numbers.
    #[error("a motion is too fast for its rates to be numbers")]
    Motion(#[from] MotionError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for TransferError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::DifferentHands { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
            Self::NoTrajectories | Self::Incomplete { .. } | Self::Motion(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoTrajectories).then_some("trajectories")
    }
}
