//! Moves the hand to the grasp of each motion by model predictive control with the cross-entropy method: the paper's
//! control baseline.
//!
//! At every control step so many sequences of a few actions are drawn, simulated from the present state, and drawn
//! again about the best of them (R. Y. Rubinstein, *The Cross-Entropy Method for Combinatorial and Continuous
//! Optimization*, 1999); the first action of the mean is executed, and the rest starts the next search. The model is
//! the physics in which motions are screened, copied from the present state bit by bit.
//!
//! One unit per object: each of its first candidates becomes another one that begins at its first step and goes for the
//! fingertips of its last one. What becomes a candidate is what was commanded, on the screen's own clock, so that the
//! screen executes the same. The lift is the screen's. What a motion costs is its control steps: those of the search,
//! and those that were executed.

mod actions;
mod config;
mod control;
mod cross_entropy;
mod error;
mod stage;
mod tips;

pub use config::CemMpcConfig;
pub use error::CemMpcError;
pub use stage::{CemMpc, CemMpcMetrics};
