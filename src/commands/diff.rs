//! `pipeline diff`

mod inputs;
mod outputs;
mod text;
mod units;
mod values;

use lake::Lake;
use serde::Serialize;

use self::{inputs::InputChange, outputs::OutputChange, values::RequestDiff};
use crate::{
    arguments::DiffArgs,
    command_line::Program,
    commands::lookup,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Everything that differs between two runs.
#[derive(Serialize)]
struct Difference {
    old: u64,
    new: u64,
    #[serde(flatten)]
    diff: RequestDiff,
    inputs: Vec<InputChange>,
    outputs: Vec<OutputChange>,
    /// Outputs that only the old run visited.
    only_old: Vec<String>,
    /// Outputs that only the new run visited.
    only_new: Vec<String>,
    /// Number of units whose records are no longer in the lake.
    n_collected: usize,
}

/// Shows what differs between two runs.
pub(crate) fn diff(program: &Program, args: &DiffArgs) -> Result<CommandOutcome, CommandError> {
    let lake = Lake::open(&program.lake);
    let (old, old_is_kept) = lookup::run_and_whether_kept(&lake, lake.find_run(&args.old)?)?;
    let (new, new_is_kept) = lookup::run_and_whether_kept(&lake, lake.find_run(&args.new)?)?;
    let pairs = units::pairs(&lake, &old.record.units, &new.record.units)?;
    let difference = Difference {
        old: old.number,
        new: new.number,
        diff: RequestDiff::compare(&old.record, &new.record),
        inputs: inputs::compare(&pairs),
        outputs: outputs::compare(&old.record, &new.record, &pairs),
        only_old: outputs::only_in(&old.record, &new.record),
        only_new: outputs::only_in(&new.record, &old.record),
        n_collected: pairs
            .iter()
            .map(|pair| pair.old.lost.len() + pair.new.lost.len())
            .sum(),
    };
    for (run, is_kept) in [(&old, old_is_kept), (&new, new_is_kept)] {
        if !is_kept {
            let number = run.number;
            program.say(
                Label::Note,
                format!(
                    "the units of run {number} were collected: only values and metrics are compared"
                ),
            );
        }
    }
    if difference.n_collected > 0 {
        program.say(
            Label::Note,
            format!(
                "the records of {} units were collected: what they read is not known",
                difference.n_collected
            ),
        );
    }
    report::answer(args.format, &difference, text::text)?;
    Ok(CommandOutcome::Done)
}
