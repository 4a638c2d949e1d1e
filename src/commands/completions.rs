//! `pipeline completions`

use clap::CommandFactory;

use crate::{
    arguments::{Cli, CompletionsArgs},
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Prints a script that completes commands and options in a shell.
pub(crate) fn completions(args: &CompletionsArgs) -> Result<CommandOutcome, CommandError> {
    let mut command = Cli::command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    report::data(&script)?;
    Ok(CommandOutcome::Done)
}
