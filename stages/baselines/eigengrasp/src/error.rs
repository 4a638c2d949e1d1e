//! Why grasps could not be searched.

use approach::ApproachError;
use dataflow::{Diagnostic, UnknownPartition};
use lake::LakeError;
use robot_meshes::LoadError;

/// Why grasps could not be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EigengraspError {
    /// There is nothing to grasp.
    #[error("there are no objects to grasp")]
    NoObjects,
    /// A name in the configuration is not an object of the lake.
    #[error("there is no object `{}`", .0.name)]
    UnknownObject(UnknownPartition),
    /// There are fewer independent grasps than eigengrasps.
    #[error("{found} trajectories cannot span {asked} eigengrasps")]
    FewGrasps {
        /// Number of trajectories.
        found: usize,
        /// Number of eigengrasps.
        asked: usize,
    },
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand cannot be given an approach.
    #[error(transparent)]
    Approach(#[from] ApproachError),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for EigengraspError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownObject(unknown) => Some(unknown.hint()),
            Self::FewGrasps { .. } => {
                Some("set `eigengrasps` to less, or retarget more recordings".to_owned())
            }
            Self::LoadRobot(err) => err.hint(),
            Self::Approach(err) => err.hint(),
            Self::Lake(err) => err.hint(),
            Self::NoObjects => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoObjects).then_some("objects")
    }
}
