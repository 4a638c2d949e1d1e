//! Reading the pipeline file that a command names.

use std::{fs, io, path::Path};

use dataflow::{Kind, Override, Pipeline, RunOptions, Stage, StageEntry, StoreUse, Sweep, missing};

use crate::{
    arguments::{PipelineArgs, ValueArgs},
    outcome::CommandError,
};

/// Reads and checks the file of one variant.
pub(crate) fn read(kinds: &[Kind], args: &PipelineArgs) -> Result<Pipeline, CommandError> {
    read_with(kinds, &args.file, &args.values)
}

/// Reads and checks a file with these overrides.
pub(crate) fn read_with(
    kinds: &[Kind],
    file: &Path,
    values: &ValueArgs,
) -> Result<Pipeline, CommandError> {
    parse(kinds, file, values, &single(values)?)
}

/// Returns the sweeps: those of the file, then those of the command line.
pub(crate) fn sweeps(args: &PipelineArgs) -> Result<Vec<Sweep>, CommandError> {
    let mut sweeps = Sweep::in_file(&args.file, &read_text(&args.file)?)?;
    sweeps.extend(args.values.overrides.iter().cloned());
    Ok(sweeps)
}

/// Reads and checks the file, and lets every `dispatch` in it move a real robot.
pub(crate) fn read_to_execute(
    kinds: &[Kind],
    args: &PipelineArgs,
) -> Result<Pipeline, CommandError> {
    let pipeline = read(kinds, args)?;
    let moves = |stage: &&StageEntry| stage.kind.name == stage_dispatch::Dispatch::KIND;
    let permits = pipeline.stages.iter().filter(moves);
    let permits = permits.flat_map(|stage| format!("{}.execute=true", stage.name).parse());
    let overrides: Vec<Override> = single(&args.values)?.into_iter().chain(permits).collect();
    parse(kinds, &args.file, &args.values, &overrides)
}

/// The values given, one for each key.
fn single(values: &ValueArgs) -> Result<Vec<Override>, CommandError> {
    let mut variants = Sweep::variants(&values.overrides);
    match (variants.pop(), variants.len()) {
        (Some(variant), 0) => Ok(variant.overrides),
        (_, n_others) => Err(CommandError::usage(
            format!("`--set` gives values for {} variants here", n_others + 1),
            "give one value; only `run` and `plan` go through several",
        )),
    }
}

fn parse(
    kinds: &[Kind],
    path: &Path,
    values: &ValueArgs,
    overrides: &[Override],
) -> Result<Pipeline, CommandError> {
    let source = read_text(path)?;
    let profile = values.profile.as_deref();
    Ok(Pipeline::parse(path, &source, kinds, profile, overrides)?)
}

fn read_text(path: &Path) -> Result<String, CommandError> {
    fs::read_to_string(path).map_err(|err| {
        let hint = match err.kind() {
            io::ErrorKind::NotFound if !Path::new("pipelines").is_dir() => format!(
                "{}; `pipeline new NAME` makes a project with one",
                missing(path)
            ),
            io::ErrorKind::NotFound => missing(path),
            _ => "name a pipeline file, e.g. `pipelines/cgf.toml`".to_owned(),
        };
        CommandError::usage(
            format!("cannot read the pipeline file `{}`: {err}", path.display()),
            hint,
        )
    })
}

/// Returns the options of a run.
pub(crate) fn options(args: &PipelineArgs, jobs: Option<u16>) -> RunOptions {
    let fresh_all = if args.fresh.iter().any(String::is_empty) {
        StoreUse::MakeAgain
    } else {
        StoreUse::UseStore
    };
    RunOptions {
        until: args.until.clone(),
        only: args.only.clone(),
        fresh: args
            .fresh
            .iter()
            .filter(|stage| !stage.is_empty())
            .cloned()
            .collect(),
        fresh_all,
        jobs: jobs.map_or(0, usize::from),
    }
}
