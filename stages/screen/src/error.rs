//! Why candidates could not be screened.

use std::path::PathBuf;

use dataflow::Diagnostic;
use robot::WrongDof;
use simulation::SimulationError;

/// Why candidates could not be screened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenError {
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
}

impl Diagnostic for ScreenError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Options { source, .. } | Self::Simulation { source, .. } => {
                source.hint().or_else(|| {
                    Some("`pipeline stages screen` lists every option with its unit".to_owned())
                })
            }
            Self::UnknownCandidate { .. } => {
                Some("make them again with `pipeline run FILE --fresh`".to_owned())
            }
            Self::Dof(_) => None,
        }
    }
}
