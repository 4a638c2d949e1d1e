//! `pipeline unit`

use std::sync::Arc;

use dataflow::{NodeName, Recompute, UnitName, did_you_mean, make_one};

use crate::{
    arguments::UnitArgs,
    command_line::Program,
    commands::{pipeline_file, worker},
    interrupt,
    outcome::{CommandError, CommandOutcome},
    progress::Screen,
    report,
};

/// Makes one unit whose inputs are in the lake, or the work items that a run sends.
pub(crate) fn unit(program: &Program, args: &UnitArgs) -> Result<CommandOutcome, CommandError> {
    match (&args.order, &args.file, &args.artifact, &args.partition) {
        (Some(order), ..) => worker::work(program, args, order),
        (None, Some(file), Some(artifact), Some(partition)) => {
            let pipeline = pipeline_file::read_with(program.kinds, file, &args.values)?;
            let node = NodeName::parse(artifact).ok_or_else(|| {
                let known: Vec<String> = pipeline
                    .nodes
                    .iter()
                    .map(|node| node.name.to_string())
                    .collect();
                let near = did_you_mean(artifact, known.iter().map(String::as_str));
                CommandError::usage(
                    format!("`{artifact}` is not of the form `stage.artifact`"),
                    near.unwrap_or_else(|| format!("its outputs are: {}", known.join(", "))),
                )
            })?;
            let lake = Arc::new(program.open_lake()?);
            interrupt::drop_on_signal(&lake)?;
            let forced = if args.fresh {
                Recompute::Yes
            } else {
                Recompute::No
            };
            let screen = Screen::new(program.quiet);
            let name = UnitName::new(&node, partition);
            let made = make_one(&pipeline, lake.as_ref(), &name, forced, &|event| {
                screen.show(event);
            });
            let shared = program.end_sharing(&lake);
            lake.leave();
            let fingerprint = made?.fingerprint.to_hex();
            report::data(format!("{fingerprint}\n").as_bytes())?;
            shared.map(|()| CommandOutcome::Done)
        }
        (None, ..) => Err(CommandError::usage(
            "no unit is named",
            "write, e.g., `pipeline unit pipelines/cgf.toml screen.rollouts 025_mug`",
        )),
    }
}
