//! Why no grasps could be learned or drawn.

use cgf::CgfError;
use dataflow::Diagnostic;

/// Why no grasps could be learned or drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GraspTtaError {
    /// There is nothing to learn from.
    #[error("none of {found} trajectories is of an object to learn from")]
    NoTrajectories {
        /// Number of trajectories.
        found: usize,
    },
    /// A trajectory's maker did not label it with its object.
    #[error("trajectory `{sequence}` has no label `object`")]
    NoObject {
        /// The trajectory's sequence.
        sequence: String,
    },
    /// The hand has no collision shape, and so no surface.
    #[error("the hand has no collision shape")]
    NoSurface,
    /// Networks could not be trained, stored or used.
    #[error(transparent)]
    Networks(#[from] CgfError),
}

impl Diagnostic for GraspTtaError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoTrajectories { .. } => Some("check `unseen_objects`".to_owned()),
            Self::NoObject { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::NoSurface => {
                Some("give every link of the URDF that may touch a `collision`".to_owned())
            }
            Self::Networks(CgfError::Diverged { .. }) => {
                Some("lower `training.learning_rate`, e.g. to a third".to_owned())
            }
            Self::Networks(CgfError::TooFewTrajectories { .. }) => {
                Some("learn from more objects".to_owned())
            }
            Self::Networks(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        match self {
            Self::NoTrajectories { .. } => Some("trajectories"),
            _ => None,
        }
    }
}
