//! Shows how often motions succeed at a robot cell.
//!
//! One table for all objects (`trials`): a row for each object and cell.

mod trials;

use dataflow::{Lines, Outputs, Report, Summary, counted};

use crate::{Dispatch, DispatchMetrics};

pub use trials::{TrialsMetrics, TrialsReport};

/// Shows how often motions succeed.
pub enum DispatchReport {}

impl Report for DispatchReport {
    type Stage = Dispatch;

    const OUTPUTS: Outputs<Dispatch> = &[&TrialsReport];

    fn lines(lines: &mut Lines<Dispatch>) {
        lines.add::<Dispatch>(Self::line);
    }
}

impl DispatchReport {
    /// Says what became of the motions that were to be sent.
    pub fn line(summary: &Summary<DispatchMetrics>) -> String {
        let DispatchMetrics {
            motions_n: motions,
            dry_n: dry,
            succeeded_n: succeeded,
            aborted_n: aborted,
            rejected_n: rejected,
            refused_n: infeasible,
            known_n: known,
            stopped_n: stopped,
            unknown_n: unknown,
            ..
        } = summary.metrics;
        if motions == 0.0 {
            return "no accepted motion to execute".to_owned();
        }
        if dry > 0.0 {
            return format!("{dry} of {motions} motions ready; nothing moved without `--execute`");
        }
        let cell = if summary.metrics.simulated_n > 0.0 {
            "the simulated cell"
        } else {
            "the robot cell"
        };
        let mut line = format!(
            "{} → {succeeded} succeed at {cell}",
            counted(motions, "motion")
        );
        let failed = motions - succeeded - aborted - rejected - infeasible - stopped - unknown;
        for (number, word) in [
            (failed, "failed"),
            (aborted, "aborted by the cell"),
            (rejected, "refused by the cell"),
            (infeasible, "infeasible"),
        ] {
            if number > 0.0 {
                line = format!("{line}, {number} {word}");
            }
        }
        if known > 0.0 {
            line = format!("{line}, {known} done before (a higher `attempt` repeats them)");
        }
        if stopped > 0.0 {
            line = format!(
                "{line}; {stopped} stopped by a person (`--fresh dispatch --set \
                 dispatch.resume_stopped=true` sends just these again)"
            );
        }
        // First, so that it is not cut.
        if unknown > 0.0 {
            line = format!("{unknown} unknown, look at the robot before going on; {line}");
        }
        line
    }
}
