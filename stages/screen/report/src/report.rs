//! The report and the line of `run`.

use dataflow::{Code, Lines, Outputs, Report, counted};
use stage_screen::{RobustnessTrials, Screen};

use crate::{RatesReport, SuccessReport};

/// Shows how often candidates hold.
pub enum ScreenReport {}

impl Report for ScreenReport {
    type Stage = Screen;

    const CODE: Code = dataflow::code!();
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
    }
}
