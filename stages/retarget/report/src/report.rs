//! The report and the lines of `run`.

use dataflow::{Code, Lines, Outputs, Report, counted};
use stage_retarget::{DistanceFields, Retarget, Trajectories};

use crate::tracking::TrackingReport;

/// Shows how well trajectories follow.
pub enum RetargetReport {}

impl Report for RetargetReport {
    type Stage = Retarget;

    const CODE: Code = dataflow::code!();
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
