//! Retargets human demonstrations to a robot hand.
//!
//! Each step of a demonstration becomes a pose of the robot's palm and a vector of joint positions,
//! by the position-based retargeting of Ye et al., "Learning Continuous Grasping Function with a
//! Dexterous Hand from Human Demonstrations" (RA-L 2023, §III-A): points of the robot follow
//! landmarks of the human hand, within the joint limits, and change little from step to step.
//! Further terms, not in the paper, keep links out of the object and above the table, keep them clear
//! of the object until the hand closes, and draw fingertips to the surface where the person's touched
//! it. Weight 0 disables a term.
//!
//! Steps are solved backward from the grasp, as in the paper's time, so that the grasp, which matters
//! most, does not depend on the steps before it.
//! Everything is computed in the object frame, in `f64`, in meters and radians. Positions never
//! leave the joint limits. The result depends only on the configuration, the URDF, the demonstration
//! and the object.

mod config;
mod error;
#[cfg(test)]
mod fixture;
mod follow;
mod goal;
#[cfg(test)]
mod other_hands;
mod recording;
pub mod report;
mod settle;
mod smoothing;
mod stage;
mod survey;
mod track;

pub use config::{Loss, RetargetConfig, Wrist};
pub use error::RetargetError;
pub use stage::{DistanceFields, FieldMetrics, Retarget, Trajectories};
pub use track::TrajectoryMetrics;
