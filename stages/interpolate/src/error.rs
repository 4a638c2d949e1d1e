//! Why motions could not be replaced.

use dataflow::{Advise, UnknownPartition};
use lake::LakeError;

/// Why motions could not be replaced.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InterpolateError {
    /// There is nothing to replace.
    #[error("there are no candidates to interpolate")]
    NoCandidates,
    /// A name in the configuration is not an object with candidates.
    #[error("there are no candidates for an object `{object}`")]
    UnknownObject {
        /// The name.
        object: String,
        /// The objects that have candidates.
        known: Vec<String>,
    },
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl From<UnknownPartition> for InterpolateError {
    fn from(unknown: UnknownPartition) -> Self {
        Self::UnknownObject {
            object: unknown.name,
            known: unknown.known,
        }
    }
}

impl Advise for InterpolateError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject { known, .. } => Some(format!("there are: {}", known.join(", "))),
            Self::Lake(err) => err.hint(),
            Self::NoCandidates => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
