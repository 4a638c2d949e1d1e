//! Why a report on screened candidates could not be made.

use charts::ChartError;
use dataflow::Advise;
use lake::LakeError;
use stage_screen::ScreenError;

/// Why a report on screened candidates could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenReportError {
    /// What the stage reads or makes cannot be used.
    #[error(transparent)]
    Screen(Box<ScreenError>),
    /// A rollout is of a candidate that there is not.
    #[error("a rollout of `{partition}` is of `{candidate}`, which is not among the candidates")]
    UnknownCandidate {
        /// The object.
        partition: String,
        /// The candidate's name.
        candidate: String,
    },
    /// A chart's data is not as it should be.
    #[error(transparent)]
    Chart(#[from] ChartError),
}

impl From<ScreenError> for ScreenReportError {
    fn from(err: ScreenError) -> Self {
        Self::Screen(Box::new(err))
    }
}

impl From<LakeError> for ScreenReportError {
    fn from(err: LakeError) -> Self {
        ScreenError::from(err).into()
    }
}

impl Advise for ScreenReportError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Screen(err) => err.hint(),
            Self::UnknownCandidate { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Chart(_) => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        match self {
            Self::Screen(err) => err.lacks(),
            Self::UnknownCandidate { .. } | Self::Chart(_) => None,
        }
    }
}
