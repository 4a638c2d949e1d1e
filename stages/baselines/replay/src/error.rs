//! Why trajectories could not be offered.

use dataflow::{Diagnostic, UnknownPartition};
use lake::LakeError;
use motion::MotionError;

/// Why trajectories could not be offered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// There is nothing to offer.
    #[error("there are no trajectories")]
    NoTrajectories,
    /// A name in the configuration is the object of no trajectory.
    #[error("there is no trajectory towards an object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// The trajectories of one object are of hands with different joints.
    #[error("the trajectories of `{object}` are of different hands: `{first}` and `{second}`")]
    DifferentHands {
        /// The object.
        object: String,
        /// A sequence.
        first: String,
        /// A sequence whose hand has other joints.
        second: String,
    },
    /// A trajectory changes too fast for its rates to be numbers.
    #[error("the palm's acceleration in a trajectory overflows")]
    Motion(#[from] MotionError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for ReplayError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::DifferentHands { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
            Self::NoTrajectories | Self::Motion(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoTrajectories).then_some("trajectories")
    }
}
