//! Why no grasps could be learned or drawn.

use approach::ApproachError;
use cgf::CgfError;
use dataflow::{Diagnostic, UnknownPartition};
use lake::LakeError;
use robot_meshes::LoadError;

/// Why no grasps could be learned or drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GraspTtaError {
    /// There is nothing to grasp.
    #[error("there are no objects to grasp")]
    NoObjects,
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
    /// A name in the configuration is not an object of the lake.
    #[error("there is no object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// The hand has no collision shape, and so no surface.
    #[error("the hand has no collision shape")]
    NoSurface,
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand cannot be given an approach.
    #[error(transparent)]
    Approach(#[from] ApproachError),
    /// Networks could not be trained, stored or used.
    #[error(transparent)]
    Networks(#[from] CgfError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for GraspTtaError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::NoTrajectories { .. } => Some("check `unseen_objects`".to_owned()),
            Self::NoObject { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::NoSurface => {
                Some("give every link of the URDF that may touch a `collision`".to_owned())
            }
            Self::LoadRobot(err) => err.hint(),
            Self::Approach(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::Networks(CgfError::Diverged { .. }) => {
                Some("lower `training.learning_rate`, e.g. to a third".to_owned())
            }
            Self::Networks(CgfError::TooFewTrajectories { .. }) => {
                Some("learn from more objects".to_owned())
            }
            Self::NoObjects | Self::Networks(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        match self {
            Self::NoObjects => Some("objects"),
            Self::NoTrajectories { .. } => Some("trajectories"),
            _ => None,
        }
    }
}
