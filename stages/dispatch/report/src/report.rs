//! The report and the lines of `run`.

use dataflow::{Code, Labels, Output, Report, Reported, Summary};
use schemas::{Table, trials::AllTrials};
use stage_dispatch::{Dispatch, DispatchError};

use crate::trials;

/// Shows how often motions succeed.
pub enum DispatchReport {}

impl Report for DispatchReport {
    type Stage = Dispatch;
    type Error = DispatchError;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: &'static [Reported<Self>] = &[Reported {
        output: Output {
            artifact: "trials",
            schema: AllTrials::VERSION,
            partition: "dispatching",
            parallel: true,
        },
        units: |_, scope| Ok(trials::units(scope)),
        foretell: |_| Some(Labels::new()),
        run: |_, inputs, cx| trials::make(inputs, cx),
        describe: trials::describe,
    }];

    /// Says what became of the motions that were to be sent.
    fn describe(_output: &str, summary: &Summary) -> String {
        let motions = summary.total("motions_n");
        if motions == 0.0 {
            return "no accepted motion to execute".to_owned();
        }
        let dry = summary.total("dry_n");
        if dry > 0.0 {
            return format!("{dry} of {motions} motions ready; nothing moved without `--execute`");
        }
        let cell = if summary.total("simulated_n") > 0.0 {
            "the simulated cell"
        } else {
            "the robot cell"
        };
        let succeeded = summary.total("succeeded_n");
        let mut line = format!("{motions} motions → {succeeded} succeed at {cell}");
        let refused = summary.total("refused_n");
        if refused > 0.0 {
            line = format!("{line}, {refused} infeasible");
        }
        let known = summary.total("known_n");
        if known > 0.0 {
            line = format!("{line}, {known} done before (a higher `attempt` repeats them)");
        }
        let stopped = summary.total("stopped_n");
        if stopped > 0.0 {
            line = format!(
                "{line}; {stopped} stopped by a person (`--fresh dispatch --set dispatch.resume_stopped=true` sends just these again)"
            );
        }
        // First, so that it is not cut.
        let unknown = summary.total("unknown_n");
        if unknown > 0.0 {
            line = format!("{unknown} unknown, look at the robot before going on; {line}");
        }
        line
    }
}
