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
    let shared = lake.sharing()?;
    let counts = shared.map(|shared| (shared.n_units_waiting, shared.n_units_damaged));
    match counts.unwrap_or_default() {
        (0, 0) => Ok(CommandOutcome::Done),
        (0, n) => Err(CommandError::failed(
            anyhow::anyhow!("{n} units are damaged here and were not sent"),
            Some("`pipeline verify --drop` removes them, and a run makes them again".to_owned()),
        )),
        (n, _) => Err(CommandError::failed(
            anyhow::anyhow!("{n} units are not in the depot"),
            None,
        )),
    }
}
