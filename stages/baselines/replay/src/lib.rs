//! Turns retargeted demonstrations into candidates, to measure how well they hold in simulation.
//!
//! One unit per object: each of its trajectories becomes one candidate, unchanged, with the object
//! in its recorded resting orientation; one too fast for numbers is a row of `draws` with its reason. The same `screen` judges learned generators, so that the
//! share of held grasps here is their reference.

mod config;
mod replay;

pub use config::ReplayConfig;
pub use replay::{Replay, ReplayMetrics};
