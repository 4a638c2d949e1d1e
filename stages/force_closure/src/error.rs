//! Why grasps could not be searched.

use std::{io, path::PathBuf};

use approach::ApproachError;
use dataflow::{Advise, missing};
use lake::LakeError;
use posture::{PostureError, SolverError};
use robot_meshes::LoadError;

/// Why grasps could not be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ForceClosureError {
    /// There is nothing to grasp.
    #[error("there are no objects to grasp")]
    NoObjects,
    /// A name in the configuration is not an object of the lake.
    #[error("there is no object `{object}`")]
    UnknownObject {
        /// The name.
        object: String,
        /// The objects that there are.
        known: Vec<String>,
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
    /// The hand table has too few fingertips for force closure.
    #[error("the hand table marks {found} fingertips, and three are the least that hold an object")]
    FewTips {
        /// How many it marks.
        found: usize,
    },
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand cannot be given an approach.
    #[error(transparent)]
    Approach(#[from] ApproachError),
    /// The solver cannot work on the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Advise for ForceClosureError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject { known, .. } => Some(format!("there are: {}", known.join(", "))),
            Self::ReadHandTable { path, .. } => Some(format!(
                "set `hand_table` to the table of a robot hand; {}",
                missing(path)
            )),
            Self::FewTips { .. } => {
                Some("give each point at a fingertip a `tip_radius_m` in the hand table".to_owned())
            }
            Self::Hand { source, .. } | Self::HandTable { source, .. } => source.hint(),
            Self::LoadRobot(err) => err.hint(),
            Self::Approach(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoObjects | Self::Solver(_) => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        matches!(self, Self::NoObjects).then_some("objects")
    }
}
