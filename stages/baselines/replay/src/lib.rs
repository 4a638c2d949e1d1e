//! Turns retargeted demonstrations into candidates, to measure how well they hold in simulation.
//!
//! One unit per object: each of its trajectories becomes one candidate, unchanged, with the object
//! in its recorded resting orientation. A trajectory whose rates overflow is a row of `draws` with the
//! reason. `screen` judges learned generators alike, so the success rate here is their reference.

mod config;
mod replay;

pub use config::ReplayConfig;
pub use replay::{Replay, ReplayMetrics};
