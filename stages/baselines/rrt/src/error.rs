//! Why no ways could be planned.

use std::path::PathBuf;

use dataflow::Diagnostic;

/// Why no ways could be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RrtError {
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
            Self::LargeShapes { .. } => Some("lengths in a URDF are in meters".to_owned()),
        }
    }
}
