//! Why grasps could not be searched.

use approach::ApproachError;
use dataflow::{Diagnostic, UnknownPartition};
use hand_files::HandFileError;
use lake::LakeError;
use posture::SolverError;

/// Why grasps could not be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ForceClosureError {
    /// There is nothing to grasp.
    #[error("there are no objects to grasp")]
    NoObjects,
    /// A name in the configuration is not an object of the lake.
    #[error("there is no object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// The hand's file has too few fingertips for force closure.
    #[error(
        "the hand's file marks {found} fingertips, and three are the least that hold an object"
    )]
    FewTips {
        /// Number of fingertips that it marks.
        found: usize,
    },
    /// The hand cannot be loaded from its files.
    #[error(transparent)]
    HandFiles(#[from] HandFileError),
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

impl Diagnostic for ForceClosureError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::FewTips { .. } => Some(
                "give each point at a fingertip a `tip_radius_m` in the hand's file".to_owned(),
            ),
            Self::HandFiles(err) => err.hint(),
            Self::Approach(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoObjects | Self::Solver(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoObjects).then_some("objects")
    }
}
