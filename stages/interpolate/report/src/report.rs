//! The line of `run`.

use dataflow::{Code, Line, Lines, Report};
use stage_interpolate::Interpolate;

/// Sums up what `interpolate` made.
pub enum InterpolateReport {}

impl Report for InterpolateReport {
    type Stage = Interpolate;

    const CODE: Code = dataflow::code!();
    const LINES: Lines<Interpolate> = &[&Line::<Interpolate>(|summary| {
        let candidates = summary.metrics.candidates;
        format!("{} objects → {candidates} straight lines", summary.n_made)
    })];
}
