//! The report and the lines of `run`.

use dataflow::{Code, Labels, Output, Report, Reported, Summary};
use schemas::{Table, success::Successes};
use stage_screen::Screen;

use crate::{ScreenReportError, success};

/// Shows how often candidates hold.
pub enum ScreenReport {}

impl Report for ScreenReport {
    type Stage = Screen;
    type Error = ScreenReportError;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: &'static [Reported<Self>] = &[Reported {
        output: Output {
            artifact: "success",
            schema: Successes::VERSION,
            partition: "screening",
            parallel: true,
        },
        units: |_, scope| Ok(success::units(scope)),
        foretell: |_| Some(Labels::new()),
        run: |_, inputs, cx| success::make(inputs, cx),
        describe: success::describe,
    }];

    fn describe(_output: &str, summary: &Summary) -> String {
        format!(
            "{:.0} candidates → {:.0} accepted",
            summary.total("candidates_n"),
            summary.total("accepted_n")
        )
    }
}
