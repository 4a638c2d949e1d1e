//! Running the variants of a sweep from the pipeline file or `--set`.

use std::time::Instant;

use dataflow::Sweep;

use crate::{
    arguments::{PipelineArgs, ValueArgs},
    command_line::Program,
    commands::pipeline_file,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// The result of a command for one variant.
pub(crate) struct Done {
    pub(crate) outcome: CommandOutcome,
    /// The last stage's summary; empty if none has run.
    pub(crate) said: String,
}

impl Done {
    /// Returns the result of a command that ran no stage.
    pub(crate) fn without_words(outcome: CommandOutcome) -> Self {
        Self {
            outcome,
            said: String::new(),
        }
    }
}

/// Runs a command for every variant, in order, with its label if there are several, and continues after a failure.
///
/// A single variant runs as without a sweep. Several are announced one by one, and their outcomes
/// are tabulated at the end.
pub(crate) fn each(
    program: &Program,
    args: &PipelineArgs,
    command: impl Fn(Option<&str>, PipelineArgs) -> Result<Done, CommandError>,
) -> Result<CommandOutcome, CommandError> {
    let mut variants: Vec<(String, PipelineArgs)> = Sweep::variants(&pipeline_file::sweeps(args)?)
        .into_iter()
        .map(|variant| {
            let values = ValueArgs {
                profile: args.values.profile.clone(),
                overrides: variant.overrides.into_iter().map(Sweep::from).collect(),
            };
            let args = PipelineArgs {
                values,
                ..args.clone()
            };
            (variant.label, args)
        })
        .collect();
    if variants.len() == 1
        && let Some((_, only)) = variants.pop()
    {
        return command(None, only).map(|done| done.outcome);
    }
    // An invalid value is reported before the first variant runs.
    for (_, args) in &variants {
        pipeline_file::read(program.kinds, args)?;
    }
    let n_variants = variants.len();
    let mut outcome = CommandOutcome::Done;
    let mut n_failed = 0;
    let mut rows = vec![report::header(["variant", "result", "time"])];
    let mut has_run = false;
    for (idx, (label, args)) in variants.into_iter().enumerate() {
        program.say_plain(&format!("variant {} of {n_variants}: {label}", idx + 1));
        let started = Instant::now();
        let said = match command(Some(&label), args) {
            Ok(done) => {
                if done.outcome == CommandOutcome::SkippedItems {
                    outcome = CommandOutcome::SkippedItems;
                }
                has_run |= !done.said.is_empty();
                done.said
            }
            Err(trouble) => {
                report::trouble(&trouble);
                n_failed += 1;
                "failed".to_owned()
            }
        };
        let time = report::duration(started.elapsed().as_secs_f64());
        rows.push(vec![label, said, time]);
    }
    if has_run {
        program.say_plain(report::columns(&rows, &[2]).trim_end());
    }
    if n_failed > 0 {
        return Err(CommandError::failed(
            anyhow::anyhow!("{n_failed} of {n_variants} variants failed"),
            None,
        ));
    }
    Ok(outcome)
}
