//! Why demonstrations could not be retargeted.

use std::path::PathBuf;

use dataflow::Diagnostic;
use hand_files::HandFileError;
use motion::MotionError;
use posture::{PostureError, SolverError};
use robot::WrongDof;
use robot_meshes::LoadError;

/// Why demonstrations could not be retargeted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RetargetError {
    /// The hand table cannot be read or used.
    #[error(transparent)]
    HandTable(#[from] HandFileError),
    /// The hand's URDF cannot be used, or lacks a link that its table names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: Box<Self>,
    },
    /// A trajectory has another number of joints than the hand.
    #[error("a trajectory cannot be recorded")]
    Dof(#[from] WrongDof),
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The steps of a demonstration make no motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The hand or its table cannot be used.
    #[error(transparent)]
    Posture(#[from] PostureError),
    /// The wrist is to be fixed, but too few points say where it is.
    #[error("`wrist = \"fixed\"` needs at least 3 points on the palm, the hand's file has {found}")]
    TooFewPalmPoints {
        /// Number of points on the palm.
        found: usize,
    },
    /// The wrist is to be fixed, but the points that say where it is let it turn.
    #[error(
        "`wrist = \"fixed\"` needs points on the palm that do not lie on one line, and the {found} in \
         the hand's file do"
    )]
    PalmPointsInLine {
        /// Number of points on the palm.
        found: usize,
    },
    /// The hand's file cannot be used with this hand.
    #[error("cannot use the hand's file `{}`", path.display())]
    InHandTable {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: Box<Self>,
    },
    /// There is no object at all.
    #[error("there are no objects, so that no demonstration has one")]
    NoObjects,
}

impl From<SolverError> for RetargetError {
    fn from(err: SolverError) -> Self {
        Self::Posture(err.into())
    }
}

impl Diagnostic for RetargetError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::HandTable(err) => err.hint(),
            Self::InHandTable { source, .. } => source.hint(),
            Self::Hand { source, .. } => source.hint().or_else(|| {
                Some("the Allegro hand's URDF is `data/robots/allegro_right.urdf`".to_owned())
            }),
            Self::LoadRobot(err) => err.hint(),
            Self::Posture(err) => err.hint(),
            Self::TooFewPalmPoints { .. } => Some(
                "add points on the root link to the hand's file, e.g. where the fingers begin, \
                 for `index_mcp`, `middle_mcp` and `ring_mcp`; their weight may be 0"
                    .to_owned(),
            ),
            Self::PalmPointsInLine { .. } => {
                Some("add a point on the root link beside that line, e.g. for `wrist`".to_owned())
            }
            Self::NoObjects | Self::Motion(_) | Self::Dof(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        // Objects are those of demonstrations: where there are none, these say why.
        matches!(self, Self::NoObjects).then_some("demonstrations")
    }
}
