//! The report and the lines of `run`.

use dataflow::{Code, Output, Report, Reported, Summary};
use schemas::{Table, sampling::Sampling};
use stage_sample::Sample;

use crate::{SampleReportError, sampling};

/// Shows how plausible and different the drawn motions are.
pub enum SampleReport {}

impl Report for SampleReport {
    type Stage = Sample;
    type Error = SampleReportError;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: &'static [Reported<Self>] = &[Reported {
        output: Output {
            artifact: "sampling",
            schema: Sampling::VERSION,
            partition: "object",
            parallel: true,
        },
        units: sampling::units,
        foretell: |unit| Some(sampling::labels(&unit.partition)),
        run: |_, inputs, cx| sampling::make(inputs, cx),
        describe: sampling::describe,
    }];

    /// Says how many motions were drawn, and of how many draws if they were chosen.
    fn describe(_output: &str, summary: &Summary) -> String {
        let (candidates, draws) = (summary.total("candidates"), summary.total("draws"));
        let of = if draws > candidates {
            format!(" of {draws} draws")
        } else {
            String::new()
        };
        format!("{} objects → {candidates} candidates{of}", summary.n_made)
    }
}
