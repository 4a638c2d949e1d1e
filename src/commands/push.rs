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
    let n_waiting = pushed?;
    program.say_shared(&lake)?;
    let shared = lake.sharing()?;
    let n_damaged = shared.as_ref().map_or(0, |shared| shared.n_units_damaged);
    match (n_waiting, n_damaged) {
        (0, 0) => Ok(CommandOutcome::Done),
        (0, n) => Err(CommandError::failed(
            anyhow::anyhow!("{n} units are damaged here and were not sent"),
            Some("`pipeline verify --drop` removes them, and a run makes them again".to_owned()),
        )),
        (n, _) => Err(CommandError::failed(
            anyhow::anyhow!("{n} units are not in the depot"),
            shared
                .and_then(|shared| shared.unsent)
                .map(|why| format!("the same command sends them when this is over: {why}")),
        )),
    }
}
