//! Why motions could not be replaced.

use dataflow::Advise;
use lake::LakeError;
use schemas::SchemaError;

/// Why motions could not be replaced.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InterpolateError {
    /// There is nothing to replace.
    #[error("there are no candidates to interpolate")]
    NoCandidates,
    /// A name in the configuration is no object with candidates.
    #[error("there are no candidates for an object `{object}`")]
    UnknownObject {
        /// The name.
        object: String,
        /// The objects that have candidates.
        known: Vec<String>,
    },
    /// The unit was given no candidates: the plan is not this stage's.
    #[error("the unit `{partition}` reads no candidates")]
    MissingInput {
        /// The unit's partition.
        partition: String,
    },
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
    /// An artifact does not follow its schema.
    #[error("cannot use `{key}`")]
    Schema {
        /// The artifact's key.
        key: String,
        /// How it differs.
        source: SchemaError,
    },
}

impl Advise for InterpolateError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject { known, .. } => Some(format!("there are: {}", known.join(", "))),
            Self::Schema { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
            Self::NoCandidates | Self::MissingInput { .. } => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
