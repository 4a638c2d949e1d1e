//! Why no ways could be planned.

use std::{io, path::PathBuf};

use dataflow::{Advise, missing};
use lake::LakeError;
use posture::PostureError;
use robot::JointMismatch;
use robot_meshes::LoadError;

/// Why no ways could be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RrtError {
    /// There is nothing to plan.
    #[error("there are no candidates to plan ways to")]
    NoCandidates,
    /// The candidates are for another hand.
    #[error("candidates of `{object}` are not for the hand `{}`", path.display())]
    AnotherHand {
        /// The object.
        object: String,
        /// The hand's URDF.
        path: PathBuf,
        /// How their joints differ from the hand's.
        source: JointMismatch,
    },
    /// The hand table cannot be read.
    #[error("cannot read the hand table `{}`", path.display())]
    ReadHandTable {
        /// The file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The hand's URDF cannot be used, or lacks a link that its table names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PostureError,
    },
    /// The hand table cannot be used.
    #[error("cannot use the hand table `{}`", path.display())]
    HandTable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PostureError,
    },
    /// The hand's collision shapes cannot be filled with spheres.
    #[error("collision shapes of link `{link}` of the hand `{}` are far larger than a hand's", path.display())]
    LargeShapes {
        /// The hand's URDF.
        path: PathBuf,
        /// The link.
        link: String,
    },
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Advise for RrtError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::AnotherHand { .. } => {
                Some("use the same `hand` in `retarget` and in `rrt`, then run again".to_owned())
            }
            Self::ReadHandTable { path, .. } => Some(format!(
                "set `hand_table` to the table of a robot hand; {}",
                missing(path)
            )),
            Self::Hand { source, .. } | Self::HandTable { source, .. } => source.hint(),
            Self::LargeShapes { .. } => Some("lengths in a URDF are in meters".to_owned()),
            Self::LoadRobot(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoCandidates => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
