//! `pipeline pull`

use dataflow::NodeName;

use crate::{
    arguments::PullArgs,
    command_line::Program,
    outcome::{CommandError, CommandOutcome},
};

/// Fetches files that earlier runs left in the depot.
pub(crate) fn pull(program: &Program, args: &PullArgs) -> Result<CommandOutcome, CommandError> {
    let lake = program.open_shared_lake()?;
    let parse = |name: &String| {
        NodeName::parse(name).ok_or_else(|| {
            CommandError::usage(
                format!("`{name}` is not of the form `stage.artifact`"),
                "`pipeline runs` lists runs, and `pipeline plan FILE` the outputs of a pipeline",
            )
        })
    };
    let outputs: Vec<NodeName> = args.artifacts.iter().map(parse).collect::<Result<_, _>>()?;
    let pulled = lake.pull(&outputs);
    lake.leave();
    let n_lost = pulled?;
    program.say_shared(&lake)?;
    match n_lost {
        0 => Ok(CommandOutcome::Done),
        n if lake.is_depot_offline() => Err(CommandError::failed(
            anyhow::anyhow!("{n} files were not fetched: the depot is offline"),
            None,
        )),
        n => Err(CommandError::failed(
            anyhow::anyhow!("{n} files are neither here nor in the depot"),
            Some(
                "`pipeline push` on the machine that made them sends them again, and a run that needs one makes it again"
                    .to_owned(),
            ),
        )),
    }
}
