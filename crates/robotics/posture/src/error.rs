//! Why a hand cannot be used.

use robot::{RobotError, spheres::TooLarge};

use crate::SolverError;

/// Why a hand or its table cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PostureError {
    /// The robot model is unsuitable.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The robot has no moving joint.
    #[error("the robot has no joint that moves")]
    NoJoint,
    /// A joint's name cannot be written in a list with commas.
    #[error("joint `{joint}` has a name that is empty or has a comma")]
    JointName {
        /// Its name.
        joint: String,
    },
    /// The collision shapes are far larger than a hand's.
    #[error(transparent)]
    LargeShapes(#[from] TooLarge),
    /// The solver cannot work on the robot.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// The text is not a hand's file.
    #[error("cannot parse it: {problem}")]
    InvalidHandTable {
        /// The problem and its place in the text.
        problem: String,
    },
    /// A value of a hand table is invalid.
    #[error("`{key}` is invalid: {problem}")]
    InvalidHandTableValue {
        /// The key.
        key: String,
        /// The problem.
        problem: String,
    },
}

impl PostureError {
    /// Returns a remedy, if one is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Robot(err) => err.hint(),
            Self::NoJoint => Some(
                "give its joints a type that moves: revolute, continuous or prismatic".to_owned(),
            ),
            Self::JointName { .. } => Some("give it another name in the URDF".to_owned()),
            Self::LargeShapes(_) => Some(
                "write lengths in meters, and leave out what is not part of the hand, e.g. a table"
                    .to_owned(),
            ),
            Self::InvalidHandTable { .. } | Self::InvalidHandTableValue { .. } => Some(
                "`pipeline doctor --robot URDF` proposes a file; those in `data/hands` are examples"
                    .to_owned(),
            ),
            Self::Solver(_) => None,
        }
    }
}
