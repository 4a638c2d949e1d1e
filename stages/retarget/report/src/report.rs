//! The report and the lines of `run`.

use dataflow::{Code, Output, Report, Reported, Summary};
use schemas::{Table, tracking::TrackingReport};
use stage_retarget::{FIELDS, Retarget, RetargetError};

use crate::tracking;

/// Shows how well trajectories follow.
pub enum RetargetReport {}

impl Report for RetargetReport {
    type Stage = Retarget;
    type Error = RetargetError;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: &'static [Reported<Self>] = &[Reported {
        output: Output {
            artifact: "tracking",
            schema: TrackingReport::VERSION,
            partition: "object",
            parallel: true,
        },
        units: |_, scope| Ok(tracking::units(scope)),
        foretell: |unit| Some(tracking::labels(&unit.partition)),
        run: |_, inputs, cx| tracking::make(inputs, cx),
        describe: tracking::describe,
    }];

    fn describe(output: &str, summary: &Summary) -> String {
        if output == FIELDS {
            return format!("{} objects → distance fields", summary.n_made);
        }
        let n_read = summary.n_made + summary.n_skipped + summary.n_filtered;
        format!(
            "{n_read} demonstrations → {} trajectories, error {:.0} mm",
            summary.n_made,
            1000.0 * summary.total("keypoint_error_m") / (summary.n_made as f64).max(1.0)
        )
    }
}
