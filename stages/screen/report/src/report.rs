//! The report and the line of `run`.

use dataflow::{Code, Lines, Outputs, Report};
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
                "{:.0} candidates → {:.0} accepted",
                all.candidates_n, all.accepted_n
            )
        });
        lines.add::<RobustnessTrials>(|summary| {
            let all = &summary.metrics;
            if all.trials_n == 0.0 {
                return "no motion tried under drawn errors".to_owned();
            }
            format!(
                "{:.0} motions × {:.0} trials with drawn errors → {:.1} % hold",
                all.motions_n,
                all.trials_n / all.motions_n,
                100.0 * all.held_n / all.trials_n
            )
        });
    }
}
