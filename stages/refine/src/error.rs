//! Why motions could not be refined.

use dataflow::Diagnostic;
use motion::MotionError;
use posture::SolverError;

/// Why motions could not be refined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// The solver cannot work on the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// Refined steps do not form a motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

impl Diagnostic for RefineError {}
