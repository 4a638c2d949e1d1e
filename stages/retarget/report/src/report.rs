//! The report and the lines of `run`.

use dataflow::{Code, Lines, Outputs, Report};
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
            format!("{} objects → distance fields", summary.n_made)
        });
        lines.add::<Trajectories>(|summary| {
            format!(
                "{} demonstrations → {} trajectories, error {:.0} mm",
                summary.item_count(),
                summary.n_made,
                1000.0 * summary.metrics.keypoint_error_m
            )
        });
    }
}
