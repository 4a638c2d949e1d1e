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
pub(crate) struct VariantResult {
    pub(crate) outcome: CommandOutcome,
    /// The last stage's summary; empty if none has run.
    pub(crate) summary: String,
}

impl VariantResult {
    /// Returns the result of a command that ran no stage.
    pub(crate) fn without_summary(outcome: CommandOutcome) -> Self {
        Self {
            outcome,
            summary: String::new(),
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
    command: impl Fn(Option<&str>, PipelineArgs) -> Result<VariantResult, CommandError>,
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
        return command(None, only).map(|result| result.outcome);
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
        let summary = match command(Some(&label), args) {
            Ok(result) => {
                if result.outcome == CommandOutcome::SkippedItems {
                    outcome = CommandOutcome::SkippedItems;
                }
                has_run |= !result.summary.is_empty();
                result.summary
            }
            Err(err) => {
                report::print_error(&err);
                n_failed += 1;
                "failed".to_owned()
            }
        };
        let time = report::duration(started.elapsed().as_secs_f64());
        rows.push(vec![label, summary, time]);
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
