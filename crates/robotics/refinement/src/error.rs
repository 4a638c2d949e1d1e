//! Why a motion could not be refined.

use motion::MotionError;
use posture::SolverError;

/// Reason why a motion could not be refined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefinementError {
    /// The solver cannot work on the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// The motion is of another hand, or the refined steps do not form one.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The refinement was canceled.
    #[error("the refinement was canceled")]
    Canceled,
}
