//! Why grasps could not be searched.

use dataflow::Diagnostic;

/// Why grasps could not be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EigengraspError {
    /// There are fewer independent grasps than eigengrasps.
    #[error("{found} trajectories cannot span {asked} eigengrasps")]
    FewGrasps {
        /// Number of trajectories.
        found: usize,
        /// Number of eigengrasps.
        asked: usize,
    },
}

impl Diagnostic for EigengraspError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::FewGrasps { .. } => {
                Some("set `eigengrasps` to less, or retarget more recordings".to_owned())
            }
        }
    }
}
