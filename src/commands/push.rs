//! `pipeline push`

use crate::{
    command_line::Program,
    outcome::{CommandError, CommandOutcome},
};

/// Sends every result of the lake's runs that the depot lacks.
pub(crate) fn push(program: &Program) -> Result<CommandOutcome, CommandError> {
    let lake = program.open_shared_lake()?;
    let pushed = lake.push();
    lake.leave();
    pushed?;
    program.say_shared(&lake)?;
    match lake.sharing()?.map(|shared| shared.n_units_waiting) {
        None | Some(0) => Ok(CommandOutcome::Done),
        Some(n) => Err(CommandError::failed(
            anyhow::anyhow!("{n} units are not in the depot"),
            None,
        )),
    }
}
