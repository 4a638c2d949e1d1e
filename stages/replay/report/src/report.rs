//! The lines of `run`.

use dataflow::{Code, Report, Summary};
use stage_replay::{Replay, ReplayError};

/// Sums up what `replay` made.
pub enum ReplayReport {}

impl Report for ReplayReport {
    type Stage = Replay;
    type Error = ReplayError;

    const CODE: Code = dataflow::code!();

    fn describe(_output: &str, summary: &Summary) -> String {
        format!(
            "{} objects → {} candidates",
            summary.n_made,
            summary.total("candidates")
        )
    }
}
