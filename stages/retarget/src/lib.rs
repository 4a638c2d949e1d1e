//! Retargets human demonstrations to a robot hand.
//!
//! `retargeting` turns each step of a demonstration into a pose of the robot's palm and a vector of joint positions.
//! This stage reads demonstrations and objects, makes a distance field of each object and a trajectory of each
//! demonstration, with a recording for a viewer, and says why it skips one.
//! The result depends only on the configuration, the URDF, the demonstration and the object.

mod config;
mod error;
mod recording;
pub mod report;
mod retarget;

pub use config::RetargetConfig;
pub use error::RetargetError;
pub use retarget::{DistanceFields, FieldMetrics, Retarget, Trajectories, TrajectoryMetrics};
