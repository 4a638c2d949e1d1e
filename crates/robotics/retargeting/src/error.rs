//! Why a motion of a person could not be retargeted.

use motion::MotionError;
use posture::SolverError;

/// Reason why a motion of a person could not be retargeted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RetargetingError {
    /// The solver cannot work on the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// The steps make no motion, e.g. because their times do not increase.
    #[error(transparent)]
    Motion(#[from] MotionError),
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
}

impl RetargetingError {
    /// Returns a remedy, if one is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::TooFewPalmPoints { .. } => Some(
                "add points on the root link to the hand's file, e.g. where the fingers begin, \
                 for `index_mcp`, `middle_mcp` and `ring_mcp`; their weight may be 0"
                    .to_owned(),
            ),
            Self::PalmPointsInLine { .. } => {
                Some("add a point on the root link beside that line, e.g. for `wrist`".to_owned())
            }
            Self::Solver(_) | Self::Motion(_) => None,
        }
    }
}
