//! Estimates closed shapes of objects from depth images, so that they can be grasped without a mesh.
//!
//! One unit per object of the views. The estimate is an object like any other, in a frame that the views define: later
//! stages sample, refine and simulate motions to it. `completions` says how it was estimated and where it lies, and
//! `distance_fields` has the distances from it.

mod complete;
mod config;
mod fields;

pub use complete::{Complete, CompleteMetrics};
pub use config::CompleteConfig;
pub use fields::{DistanceFields, FieldMetrics};
