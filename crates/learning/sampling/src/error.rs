//! Why no motions could be sampled.

use cgf::CgfError;
use motion::MotionError;
use robot::WrongDof;

/// Why no motions could be sampled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SamplingError {
    /// The rest of the motions was to be left.
    #[error("the sampling was canceled")]
    Canceled,
    /// An object has no resting orientation.
    #[error("object `{0}` has no resting orientation")]
    NoRest(String),
    /// A name in the options is no demonstration that the function knows.
    #[error("the grasping function knows no demonstration `{name}`")]
    UnknownDemonstration {
        /// The name.
        name: String,
        /// Those that it was trained on, or that were kept back.
        known: Vec<String>,
    },
    /// A motion has another number of joints than the hand.
    #[error("a motion does not fit the hand")]
    Dof(#[from] WrongDof),
    /// The grasping function's outputs are no motion.
    #[error("the decoded steps do not form a motion")]
    Motion(#[from] MotionError),
    /// The grasping function cannot be used.
    #[error(transparent)]
    Cgf(#[from] CgfError),
}
