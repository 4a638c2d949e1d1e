//! Shows how well trajectories follow their demonstrations.
//!
//! One table for each object (`tracking`): errors of the fingertips, contact gaps and depths at the
//! grasp, speeds. This crate links the stage `retarget` and not the other way around: editing it
//! retargets nothing again.

mod report;
mod tracking;

pub use report::RetargetReport;
pub use tracking::{TrackingMetrics, TrackingReport};
