//! Why no ways could be planned.

use std::path::PathBuf;

use dataflow::Diagnostic;
use robot::JointMismatch;

/// Why no ways could be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RrtError {
    /// The candidates are for another hand.
    #[error("candidates of `{object}` are not for the hand `{}`", path.display())]
    AnotherHand {
        /// The object.
        object: String,
        /// The hand's URDF.
        path: PathBuf,
        /// Difference of their joints from the hand's.
        source: JointMismatch,
    },
    /// The hand's collision shapes cannot be filled with spheres.
    #[error("collision shapes of link `{link}` of the hand `{}` are far larger than a hand's", path.display())]
    LargeShapes {
        /// The hand's URDF.
        path: PathBuf,
        /// The link.
        link: String,
    },
}

impl Diagnostic for RrtError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::AnotherHand { .. } => {
                Some("use the same `hand` in `retarget` and in `rrt`, then run again".to_owned())
            }
            Self::LargeShapes { .. } => Some("lengths in a URDF are in meters".to_owned()),
        }
    }
}
