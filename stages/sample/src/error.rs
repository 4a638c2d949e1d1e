//! Why no motions could be drawn.

use cgf::CgfError;
use dataflow::Advise;
use lake::LakeError;
use schemas::SchemaError;

/// Why no motions could be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// A name in the configuration is no object of the lake.
    #[error("there is no object `{object}`")]
    UnknownObject {
        /// The name.
        object: String,
        /// The objects that there are.
        known: Vec<String>,
    },
    /// A value of the configuration cannot be used.
    #[error("`{key}` is {value}, expected {expected}")]
    Config {
        /// The key.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What would be valid.
        expected: &'static str,
    },
    /// An input has no partition, or a partition lacks a file.
    #[error("the {what} is missing")]
    Missing {
        /// What is missing.
        what: &'static str,
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
    /// The grasping function cannot be used.
    #[error(transparent)]
    Cgf(#[from] CgfError),
}

impl Advise for SampleError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject { known, .. } => Some(format!("there are: {}", known.join(", "))),
            Self::Missing { .. } | Self::Schema { .. } => {
                Some("make it again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
            Self::Cgf(
                CgfError::Weights(_)
                | CgfError::Description(_)
                | CgfError::Tensor { .. }
                | CgfError::Version { .. },
            ) => Some("train again with `pipeline run FILE --fresh`".to_owned()),
            Self::Config { .. } | Self::Cgf(_) => None,
        }
    }
}
