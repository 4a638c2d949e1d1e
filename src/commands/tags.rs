//! `pipeline tag` and `pipeline untag`

use lake::Lake;

use crate::{
    arguments::{TagArgs, UntagArgs},
    command_line::Program,
    label::Label,
    outcome::{CommandError, CommandOutcome},
};

/// Tags a run.
pub(crate) fn tag(program: &Program, args: &TagArgs) -> Result<CommandOutcome, CommandError> {
    let lake = Lake::open(&program.lake);
    let run = lake.find_run(&args.run)?;
    let before = lake.tag(&args.name, run)?;
    let was = match before {
        Some(before) if before != run => format!(", no longer run {before}"),
        _ => String::new(),
    };
    program.say(Label::Done, format!("`{}` is run {run}{was}", args.name));
    Ok(CommandOutcome::Done)
}

/// Removes a tag from its run.
pub(crate) fn untag(program: &Program, args: &UntagArgs) -> Result<CommandOutcome, CommandError> {
    Lake::open(&program.lake).untag(&args.name)?;
    program.say(Label::Done, format!("no run is tagged `{}` now", args.name));
    Ok(CommandOutcome::Done)
}
