//! Errors of planning a hand's approach.

use dataflow::Diagnostic;
use robot::{JointMismatch, RobotError, WrongDof, spheres::TooLarge};

/// Reason why no approach can be planned for a hand.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ApproachError {
    /// The robot has no thumb, or no finger beside it.
    #[error("the robot has no finger beside a thumb, and so no side of the palm that grasps")]
    NoPalmSide,
    /// The collision shapes are far larger than a hand's.
    #[error(transparent)]
    LargeShapes(#[from] TooLarge),
    /// A joint that is named does not exist.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A trajectory is of another hand.
    #[error("trajectory `{sequence}` was made for another hand")]
    AnotherHand {
        /// The trajectory.
        sequence: String,
        /// Difference of its joints from the hand's.
        source: JointMismatch,
    },
    /// Trajectories are of hands with different joints.
    #[error("trajectories `{first}` and `{second}` are of different hands")]
    DifferentHands {
        /// A sequence.
        first: String,
        /// A sequence whose hand has other joints.
        second: String,
    },
    /// There is no trajectory, and so no place where motions start.
    #[error("there is no trajectory that a motion could start like")]
    NoStart,
    /// A posture has another number of joints than the hand.
    #[error("a posture does not fit the hand")]
    Dof(#[from] WrongDof),
    /// The steps are no motion.
    #[error("the steps of an approach do not form a motion")]
    Motion(#[from] motion::MotionError),
}

impl Diagnostic for ApproachError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoPalmSide => {
                Some("`pipeline doctor --robot URDF` shows which fingers were found".to_owned())
            }
            Self::LargeShapes(_) => Some("URDFs are in meters".to_owned()),
            Self::Robot(err) => err.hint(),
            Self::AnotherHand { .. } => Some(
                "give the stage the URDF with which `retarget` made the trajectories".to_owned(),
            ),
            Self::DifferentHands { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::NoStart => Some("wire `inputs.trajectories` to a `retarget` stage".to_owned()),
            Self::Dof(_) | Self::Motion(_) => None,
        }
    }
}
