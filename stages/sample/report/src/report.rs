//! The report and the line of `run`.

use dataflow::{Code, Lines, Outputs, Report, counted};
use stage_sample::Sample;

use crate::SamplingReport;

/// Shows how plausible and different the drawn motions are.
pub enum SampleReport {}

impl Report for SampleReport {
    type Stage = Sample;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: Outputs<Sample> = &[&SamplingReport];

    /// Says how many motions were drawn, and of how many draws if they were chosen.
    fn lines(lines: &mut Lines<Sample>) {
        lines.add::<Sample>(|summary| {
            let (candidates, draws) = (summary.metrics.candidates, summary.metrics.draws);
            let of = if draws > candidates {
                format!(" of {}", counted(draws, "sample"))
            } else {
                String::new()
            };
            format!(
                "{} → {}{of}",
                counted(summary.n_made, "object"),
                counted(candidates, "candidate")
            )
        });
    }
}
