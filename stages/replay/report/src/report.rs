//! The line of `run`.

use dataflow::{Code, Line, Lines, Report};
use stage_replay::Replay;

/// Sums up what `replay` made.
pub enum ReplayReport {}

impl Report for ReplayReport {
    type Stage = Replay;

    const CODE: Code = dataflow::code!();
    const LINES: Lines<Replay> = &[&Line::<Replay>(|summary| {
        let candidates = summary.metrics.candidates;
        format!("{} objects → {candidates} candidates", summary.n_made)
    })];
}
