//! Moves the hand to the grasp of each motion by model predictive control ([`cem_mpc`](::cem_mpc)): the paper's
//! control baseline.
//!
//! One unit per object: each of its first candidates becomes another one that begins at its first step and goes for the
//! fingertips of its last one. What becomes a candidate is what was commanded, on the screen's own clock, so that the
//! screen executes the same. The lift is the screen's. What a motion costs is its control steps: those of the search,
//! and those that were executed.

mod cem_mpc;
mod config;
mod error;

pub use self::cem_mpc::{CemMpc, CemMpcMetrics};
pub use config::CemMpcConfig;
pub use error::CemMpcError;
