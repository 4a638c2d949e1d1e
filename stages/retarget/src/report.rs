//! Shows how well trajectories follow their demonstrations.
//!
//! One table for each object (`tracking`): errors of the fingertips, contact gaps and depths at the
//! grasp, speeds.

mod tracking;

use dataflow::{Lines, Outputs, Report, counted};

use crate::{DistanceFields, Retarget, Trajectories};

pub use tracking::{TrackingMetrics, TrackingReport};

/// Shows how well trajectories follow.
pub enum RetargetReport {}

impl Report for RetargetReport {
    type Stage = Retarget;

    const OUTPUTS: Outputs<Retarget> = &[&TrackingReport];

    fn lines(lines: &mut Lines<Retarget>) {
        lines.add::<DistanceFields>(|summary| {
            format!("{} → distance fields", counted(summary.n_made, "object"))
        });
        lines.add::<Trajectories>(|summary| {
            format!(
                "{} → {}{}, error {:.0} mm",
                counted(summary.item_count(), "demonstration"),
                counted(summary.n_made, "trajectory"),
                match summary.n_skipped {
                    0 => String::new(),
                    n => format!(", {n} skipped"),
                },
                1000.0 * summary.metrics.keypoint_error_m
            )
        });
    }
}
