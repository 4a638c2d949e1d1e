//! Shows how often candidates succeed, with what confidence, and why the others fail.
//!
//! Two tables and their charts for all objects: `success`, a row for each object, generator and
//! origin of the motions, and `rates`, means over the objects with their intervals.

mod rates;
mod success;

use dataflow::{Lines, Outputs, Report, counted};

use crate::{PoseErrorTrials, RobustnessTrials, Screen, pose_errors::BOTH};

pub use rates::{RatesMetrics, RatesReport};
pub use success::{SuccessMetrics, SuccessReport};

/// Shows how often candidates succeed.
pub enum ScreenReport {}

impl Report for ScreenReport {
    type Stage = Screen;

    const OUTPUTS: Outputs<Screen> = &[&SuccessReport, &RatesReport];

    fn lines(lines: &mut Lines<Screen>) {
        lines.add::<Screen>(|summary| {
            let all = &summary.metrics;
            format!(
                "{} → {:.0} accepted",
                counted(all.candidates_n, "candidate"),
                all.accepted_n
            )
        });
        lines.add::<RobustnessTrials>(|summary| {
            let all = &summary.metrics;
            if all.trials_n == 0.0 {
                return "no accepted motion tried with sampled errors".to_owned();
            }
            format!(
                "{} × {:.0} trials with errors → {:.1} % succeed",
                counted(all.motions_n, "accepted motion"),
                all.trials_n / all.motions_n,
                100.0 * all.held_n / all.trials_n
            )
        });
        lines.add::<PoseErrorTrials>(|summary| {
            let all = &summary.metrics;
            if all.motions_n == 0.0 {
                return "no motion tried with the object off its pose".to_owned();
            }
            let (position_mm, yaw_deg) = BOTH;
            format!(
                "{}: {:.0} % succeed, {:.0} % with the object {position_mm} mm and {yaw_deg}° off",
                counted(all.motions_n, "motion"),
                100.0 * all.held_n / all.motions_n,
                100.0 * all.off_held_n / all.motions_n
            )
        });
    }
}
