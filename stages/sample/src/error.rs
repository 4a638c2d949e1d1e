//! Why no motions could be drawn.

use cgf::CgfError;
use dataflow::Diagnostic;
use motion::MotionError;
use robot::{JointMismatch, WrongDof, spheres::TooLarge};

/// Why no motions could be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// The function is to see another object's shape, and there is none.
    #[error("`shape` is \"other\", and there is no other object than `{0}`")]
    NoOther(String),
    /// An object has no resting orientation.
    #[error("object `{0}` has no resting orientation")]
    NoRest(String),
    /// A name in the configuration is no demonstration that the function knows.
    #[error("the grasping function knows no demonstration `{name}`")]
    UnknownDemonstration {
        /// The name.
        name: String,
        /// Those that it was trained on, or that were kept back.
        known: Vec<String>,
    },
    /// Motions are of another hand.
    #[error("the {what} was made for another hand")]
    AnotherHand {
        /// Kind of weights, e.g. `grasping function`.
        what: String,
        /// The difference of its joints from the hand's.
        source: JointMismatch,
    },
    /// A motion has another number of joints than the hand.
    #[error("a motion does not fit the hand")]
    Dof(#[from] WrongDof),
    /// The grasping function's outputs are no motion.
    #[error("the decoded steps do not form a motion")]
    Motion(#[from] MotionError),
    /// The collision shapes are far larger than a hand's.
    #[error(transparent)]
    LargeShapes(#[from] TooLarge),
    /// The grasping function cannot be used.
    #[error(transparent)]
    Cgf(#[from] CgfError),
}

impl Diagnostic for SampleError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownDemonstration { name, known } => {
                let near = dataflow::did_you_mean(name, known.iter().map(String::as_str));
                let some: Vec<&str> = known.iter().take(5).map(String::as_str).collect();
                Some(near.unwrap_or_else(|| {
                    format!("there are {}, such as {}", known.len(), some.join(", "))
                }))
            }
            Self::NoOther(_) => {
                Some("leave `shape` out, or ingest recordings of several objects".to_owned())
            }
            Self::NoRest(_) => {
                Some("`pipeline inspect ingest.objects` shows its orientations".to_owned())
            }
            Self::AnotherHand { .. } => Some(
                "give `sample.hand` the URDF with which `retarget` and `train` made them"
                    .to_owned(),
            ),
            Self::LargeShapes(_) => Some("URDFs are in meters".to_owned()),
            Self::Dof(_) => Some("make it again with `pipeline run FILE --fresh`".to_owned()),
            Self::Cgf(
                CgfError::Weights(_)
                | CgfError::Description(_)
                | CgfError::RestingPose { .. }
                | CgfError::Tensor { .. }
                | CgfError::Version { .. },
            ) => Some("train again with `pipeline run FILE --fresh`".to_owned()),
            Self::Motion(_) | Self::Cgf(_) => None,
        }
    }
}
