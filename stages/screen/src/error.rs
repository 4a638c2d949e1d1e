//! Why candidates could not be screened.

use std::path::PathBuf;

use dataflow::Diagnostic;
use lake::LakeError;
use robot::{JointMismatch, WrongDof};
use robot_meshes::LoadError;
use simulation::SimulationError;

/// Why candidates could not be screened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenError {
    /// The robot cannot be loaded.
    #[error(transparent)]
    LoadRobot(#[from] LoadError),
    /// The hand and the options do not go together, whatever is screened.
    #[error("cannot simulate the hand `{}`", path.display())]
    Options {
        /// The hand's URDF.
        path: PathBuf,
        /// The problem.
        source: SimulationError,
    },
    /// Nothing can be simulated with this hand and these options.
    #[error("cannot simulate `{partition}` with the hand `{}`", path.display())]
    Simulation {
        /// The object.
        partition: String,
        /// The hand's URDF.
        path: PathBuf,
        /// The problem.
        source: SimulationError,
    },
    /// The candidates are for another hand.
    #[error("candidates of `{partition}` are not for the hand `{}`", path.display())]
    AnotherHand {
        /// The object.
        partition: String,
        /// The hand's URDF.
        path: PathBuf,
        /// The difference of their joints from the hand's.
        source: JointMismatch,
    },
    /// There is nothing to screen.
    #[error("there are no candidates to screen")]
    NoCandidates,
    /// A rollout is of a candidate that there is not.
    #[error("a rollout of `{partition}` is of `{candidate}`, which is not among the candidates")]
    UnknownCandidate {
        /// The object.
        partition: String,
        /// The candidate's name.
        candidate: String,
    },
    /// A rollout has another number of joints than the hand.
    #[error("a rollout cannot be recorded")]
    Dof(#[from] WrongDof),
    /// An artifact cannot be read or written.
    #[error(transparent)]
    Lake(#[from] LakeError),
}

impl Diagnostic for ScreenError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::LoadRobot(err) => err.hint(),
            Self::Options { source, .. } | Self::Simulation { source, .. } => {
                source.hint().or_else(|| {
                    Some("`pipeline stages screen` lists every option with its unit".to_owned())
                })
            }
            Self::AnotherHand { .. } => {
                Some("use the same `hand` in `retarget` and in `screen`, then run again".to_owned())
            }
            Self::UnknownCandidate { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Lake(err) => err.hint(),
            Self::NoCandidates | Self::Dof(_) => None,
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        matches!(self, Self::NoCandidates).then_some("candidates")
    }
}
