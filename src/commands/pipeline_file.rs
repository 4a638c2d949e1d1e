//! Reading the pipeline file that a command names.

use std::fs;

use dataflow::{FreshAll, Kind, Override, Pipeline, RunOptions, Stage, StageEntry};

use crate::{arguments::PipelineArgs, outcome::Trouble};

/// Reads and checks the file.
pub(crate) fn read(kinds: &[Kind], args: &PipelineArgs) -> Result<Pipeline, Trouble> {
    parse(kinds, args, &args.overrides)
}

/// Reads and checks the file, and lets every `dispatch` in it move a real robot.
pub(crate) fn read_to_execute(kinds: &[Kind], args: &PipelineArgs) -> Result<Pipeline, Trouble> {
    let pipeline = read(kinds, args)?;
    let moves = |stage: &&StageEntry| stage.kind.name == stage_dispatch::Dispatch::KIND;
    let permits = pipeline.stages.iter().filter(moves);
    let permits = permits.flat_map(|stage| format!("{}.execute=true", stage.name).parse());
    let overrides: Vec<Override> = args.overrides.iter().cloned().chain(permits).collect();
    parse(kinds, args, &overrides)
}

fn parse(kinds: &[Kind], args: &PipelineArgs, overrides: &[Override]) -> Result<Pipeline, Trouble> {
    let path = &args.file;
    let source = fs::read_to_string(path).map_err(|err| {
        Trouble::usage(
            format!("cannot read the pipeline file `{}`: {err}", path.display()),
            "name a pipeline file, e.g. `pipelines/cgf.toml`",
        )
    })?;
    let profile = args.profile.as_deref();
    Ok(Pipeline::parse(path, &source, kinds, profile, overrides)?)
}

/// Returns what to run and how.
pub(crate) fn options(args: &PipelineArgs, jobs: Option<u16>) -> RunOptions {
    let fresh_all = if args.fresh.iter().any(String::is_empty) {
        FreshAll::MakeAgain
    } else {
        FreshAll::UseStore
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
