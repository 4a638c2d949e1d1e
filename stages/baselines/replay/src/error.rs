//! Why trajectories could not be offered.

use dataflow::Diagnostic;
use motion::MotionError;

/// Why trajectories could not be offered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
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
}

impl Diagnostic for ReplayError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::DifferentHands { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Motion(_) => None,
        }
    }
}
