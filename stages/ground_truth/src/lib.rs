//! Puts motions that were planned on estimated objects before the true ones: for simulations, which know both.
//!
//! One unit per object. A robot executes a motion where the camera's world says; the object lies where it lies. The motion
//! becomes one in the frame of the true object's mesh, which lies as it lay before the camera, so that every stage judges
//! it as it judges others. No motion of another stage depends on the true pose.

mod config;
mod ground_truth;

pub use config::GroundTruthConfig;
pub use ground_truth::{GroundTruth, GroundTruthMetrics};
