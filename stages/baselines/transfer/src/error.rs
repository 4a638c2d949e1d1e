//! Why demonstrations could not be carried over.

use dataflow::Diagnostic;
use motion::MotionError;

/// Why demonstrations could not be carried over.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError {
    /// An object has no points or no resting orientation.
    #[error("object `{object}` has no {missing}")]
    Incomplete {
        /// The object.
        object: String,
        /// The missing property.
        missing: &'static str,
    },
    /// A motion has rates that are no numbers.
    #[error("a motion is too fast for its rates to be numbers")]
    Motion(#[from] MotionError),
}

impl Diagnostic for TransferError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Incomplete { .. } => Some(
                "`pipeline inspect ingest.objects` lists the objects; with a name after it, it shows that one".to_owned(),
            ),
            Self::Motion(_) => None,
        }
    }
}
