//! Replaces each motion by the straight line between its ends: the paper's linear baseline.
//!
//! One unit per object: every candidate becomes another one with the same first and last step, the same
//! times and the same object, and nothing in between but a line (Ye et al., *Learning Continuous Grasping
//! Function with a Dexterous Hand from Human Demonstrations*, 2023, section IV). Its rates are exact.
//! Nothing is judged here: `screen` does that for every generator alike.

mod config;
mod error;
mod line;
mod stage;

pub use config::InterpolateConfig;
pub use error::InterpolateError;
pub use stage::{Interpolate, InterpolateMetrics};
