//! Why motions could not be replaced.

use dataflow::{Diagnostic, UnknownPartition};
use lake::LakeError;

/// Why motions could not be replaced.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InterpolateError {
    /// There is nothing to replace.
    #[error("there are no candidates to interpolate")]
    NoCandidates,
    /// A name in the configuration is not an object with candidates.
    #[error("there are no candidates for an object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for InterpolateError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::Lake(err) => err.hint(),
            Self::NoCandidates => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
