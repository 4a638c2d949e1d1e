//! Shows how plausible and how different the motions are that were drawn.
//!
//! One table and its charts for each object (`sampling`): limits, depth in object and table, distance
//! from the demonstrations and from each other. Where all motions are one, the function has
//! collapsed.

mod charts;
mod measure;
mod sampling;

use dataflow::{Lines, Outputs, Report, counted};

use crate::Sample;

pub use sampling::{SamplingMetrics, SamplingReport};

/// Shows how plausible and different the drawn motions are.
pub enum SampleReport {}

impl Report for SampleReport {
    type Stage = Sample;

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
