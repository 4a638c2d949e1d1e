//! The report and the line of `run`.

use dataflow::{Code, Lines, Outputs, Report};
use stage_screen::Screen;

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
    }
}
