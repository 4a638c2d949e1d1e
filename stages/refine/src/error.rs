//! Why motions could not be refined.

use dataflow::Diagnostic;
use hand_files::HandFileError;
use lake::LakeError;
use motion::MotionError;
use posture::SolverError;

/// Why motions could not be refined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// There is nothing to refine.
    #[error("there are no candidates to refine")]
    NoCandidates,
    /// The hand cannot be loaded from its files.
    #[error(transparent)]
    HandFiles(#[from] HandFileError),
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

impl Diagnostic for RefineError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::HandFiles(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoCandidates | Self::Motion(_) | Self::Solver(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
