//! Replaces each motion by the straight line between its ends: the paper's linear baseline.
//!
//! One unit per object: every candidate becomes another one with the same first and last step, the same
//! times and the same object, and a straight line in between (Ye et al., *Learning Continuous Grasping
//! Function with a Dexterous Hand from Human Demonstrations*, 2023, section IV). Its rates are exact.
//! Nothing is judged here: `screen` judges every generator alike.

mod config;
mod interpolate;
mod line;

pub use config::InterpolateConfig;
pub use interpolate::{Interpolate, InterpolateMetrics};
