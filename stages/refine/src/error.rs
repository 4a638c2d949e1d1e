//! Why motions could not be refined.

use std::{io, path::PathBuf};

use dataflow::{Advise, missing};
use lake::LakeError;
use motion::MotionError;
use posture::{PostureError, SolverError};
use robot_meshes::LoadError;

/// Why motions could not be refined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// There is nothing to refine.
    #[error("there are no candidates to refine")]
    NoCandidates,
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
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The solver cannot work on the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// Refined steps do not form a motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Advise for RefineError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::ReadHandTable { path, .. } => Some(format!(
                "set `hand_table` to the table of a robot hand; {}",
                missing(path)
            )),
            Self::LoadRobot(err) => err.hint(),
            Self::Hand { source, .. } | Self::HandTable { source, .. } => source.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoCandidates | Self::Motion(_) | Self::Solver(_) => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
