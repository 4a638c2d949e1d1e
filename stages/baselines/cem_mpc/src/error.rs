//! Why no motions could be controlled.

use std::path::PathBuf;

use dataflow::Diagnostic;
use robot::RobotError;
use simulation::SimulationError;

/// Why no motions could be controlled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CemMpcError {
    /// The hand's URDF cannot be used, or lacks a link that its table names.
    #[error("cannot use the hand's URDF `{}`", path.display())]
    Hand {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: RobotError,
    },
    /// The hand's file marks no fingertip.
    #[error("the hand's file `{}` marks no fingertip", path.display())]
    NoFingertip {
        /// The file.
        path: PathBuf,
    },
    /// Nothing can be simulated with this hand and these options.
    #[error("cannot simulate the hand `{}`", path.display())]
    Simulation {
        /// The hand's URDF.
        path: PathBuf,
        /// The cause.
        source: SimulationError,
    },
}

impl Diagnostic for CemMpcError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::NoFingertip { .. } => Some(
                "give the points at the fingertips a `tip_radius_m`; one of them is enough"
                    .to_owned(),
            ),
            Self::Simulation { source, .. } => source.hint().or_else(|| {
                Some("`pipeline stages cem_mpc` lists every option with its unit".to_owned())
            }),
            Self::Hand { .. } => None,
        }
    }
}
