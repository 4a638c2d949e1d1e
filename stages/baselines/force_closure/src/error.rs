//! Why grasps could not be searched.

use dataflow::Diagnostic;

/// Why grasps could not be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ForceClosureError {
    /// The hand's file has too few fingertips for force closure.
    #[error(
        "the hand's file marks {found} fingertips, and three are the least that hold an object"
    )]
    FewTips {
        /// Number of fingertips that it marks.
        found: usize,
    },
}

impl Diagnostic for ForceClosureError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::FewTips { .. } => Some(
                "give each point at a fingertip a `tip_radius_m` in the hand's file".to_owned(),
            ),
        }
    }
}
