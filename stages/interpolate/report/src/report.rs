//! The lines of `run`.

use dataflow::{Code, Report, Summary};
use stage_interpolate::{Interpolate, InterpolateError};

/// Sums up what `interpolate` made.
pub enum InterpolateReport {}

impl Report for InterpolateReport {
    type Stage = Interpolate;
    type Error = InterpolateError;

    const CODE: Code = dataflow::code!();

    fn describe(_output: &str, summary: &Summary) -> String {
        let candidates = summary.total("candidates");
        format!("{} objects → {candidates} straight lines", summary.n_made)
    }
}
