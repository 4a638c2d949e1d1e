//! Offers retargeted demonstrations as candidates, so that physics can say what they are worth.
//!
//! One unit per object: each of its trajectories becomes one candidate, unchanged, with the object
//! lying as it lay. What is learned from the trajectories is judged by the same `screen`, so that
//! their share of held grasps is the bound to compare a generator with.

mod config;
mod error;
mod stage;

pub use config::ReplayConfig;
pub use error::ReplayError;
pub use stage::{Replay, ReplayMetrics};
