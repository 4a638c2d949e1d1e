//! Why a report on screened candidates could not be made.

use dataflow::Advise;
use lake::LakeError;

/// Why a report on screened candidates could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenReportError {
    /// A rollout is of a candidate that there is not.
    #[error("a rollout of `{partition}` is of `{candidate}`, which is not among the candidates")]
    UnknownCandidate {
        /// The object.
        partition: String,
        /// The candidate's name.
        candidate: String,
    },
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Advise for ScreenReportError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownCandidate { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
        }
    }
}
