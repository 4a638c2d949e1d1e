//! Why a report on drawn motions could not be made.

use charts::ChartError;
use dataflow::Advise;
use lake::LakeError;
use robot::WrongDof;
use stage_sample::SampleError;

/// Why a report on drawn motions could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SampleReportError {
    /// What the stage reads too cannot be used.
    #[error(transparent)]
    Sample(Box<SampleError>),
    /// A chart's data is not as it should be.
    #[error(transparent)]
    Chart(#[from] ChartError),
}

impl From<SampleError> for SampleReportError {
    fn from(err: SampleError) -> Self {
        Self::Sample(Box::new(err))
    }
}

impl From<WrongDof> for SampleReportError {
    fn from(err: WrongDof) -> Self {
        SampleError::from(err).into()
    }
}

impl From<LakeError> for SampleReportError {
    fn from(err: LakeError) -> Self {
        SampleError::from(err).into()
    }
}

impl Advise for SampleReportError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Sample(err) => err.hint(),
            Self::Chart(_) => None,
        }
    }

    fn lacks(&self) -> Option<&'static str> {
        match self {
            Self::Sample(err) => err.lacks(),
            Self::Chart(_) => None,
        }
    }
}
