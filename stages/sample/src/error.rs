//! Why no motions could be drawn.

use cgf::CgfError;
use dataflow::Diagnostic;
use motion::MotionError;
use robot::{JointMismatch, WrongDof, spheres::TooLarge};
use sampling::SamplingError;

/// Why no motions could be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// The function is to see another object's shape, and there is none.
    #[error("`shape` is \"other\", and there is no other object than `{0}`")]
    NoOther(String),
    /// Motions are of another hand.
    #[error("the {what} was made for another hand")]
    HandMismatch {
        /// Kind of weights, e.g. `grasping function`.
        what: String,
        /// The difference of its joints from the hand's.
        source: JointMismatch,
    },
    /// The collision shapes are far larger than a hand's.
    #[error(transparent)]
    LargeShapes(#[from] TooLarge),
    /// The motions cannot be sampled or measured.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
}

impl From<CgfError> for SampleError {
    fn from(err: CgfError) -> Self {
        SamplingError::from(err).into()
    }
}

impl From<MotionError> for SampleError {
    fn from(err: MotionError) -> Self {
        SamplingError::from(err).into()
    }
}

impl From<WrongDof> for SampleError {
    fn from(err: WrongDof) -> Self {
        SamplingError::from(err).into()
    }
}

impl Diagnostic for SampleError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoOther(_) => {
                Some("leave `shape` out, or ingest recordings of several objects".to_owned())
            }
            Self::HandMismatch { .. } => Some(
                "give `sample.hand` the URDF with which `retarget` and `train` made them"
                    .to_owned(),
            ),
            Self::LargeShapes(_) => Some("URDFs are in meters".to_owned()),
            Self::Sampling(err) => hint(err),
        }
    }
}

fn hint(err: &SamplingError) -> Option<String> {
    match err {
        SamplingError::UnknownDemonstration { name, known } => {
            let near = dataflow::did_you_mean(name, known.iter().map(String::as_str));
            let some: Vec<&str> = known.iter().take(5).map(String::as_str).collect();
            Some(near.unwrap_or_else(|| {
                format!("there are {}, such as {}", known.len(), some.join(", "))
            }))
        }
        SamplingError::NoRest(_) => {
            Some("`pipeline inspect ingest.objects` shows its orientations".to_owned())
        }
        SamplingError::Dof(_) => Some("make it again with `pipeline run FILE --fresh`".to_owned()),
        SamplingError::Cgf(
            CgfError::Weights(_)
            | CgfError::Description(_)
            | CgfError::RestingPose { .. }
            | CgfError::Tensor { .. }
            | CgfError::Version { .. },
        ) => Some("train again with `pipeline run FILE --fresh`".to_owned()),
        _ => None,
    }
}
