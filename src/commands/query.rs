//! `pipeline query`

mod artifacts;
mod cells;
mod faults;
pub(super) mod page;
mod print;
mod question;
mod tables;

use lake::Lake;

use self::{page::Page, tables::Tables};
use crate::{
    arguments::{QueryArgs, QueryFormat},
    command_line::Program,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Answers a question in SQL over the lake's tables.
pub(crate) fn query(program: &Program, args: &QueryArgs) -> Result<CommandOutcome, CommandError> {
    question::check(&args.sql)?;
    let lake = Lake::open(&program.lake);
    let run = match &args.run {
        Some(name) => Some(lake.run(lake.find_run(name)?)?),
        None => None,
    };
    let tables = Tables::open(&lake, &args.sql, run.as_ref())?;
    for (table, n) in &tables.collected {
        program.say(&format!(
            "note   {n} partitions of `{table}` were collected"
        ));
    }
    let mut answer = tables.answer(&args.sql)?;
    let bytes = match args.format {
        QueryFormat::Table => {
            let printed = print::table(&answer, Page::of_stdout());
            report::data(printed.text.as_bytes())?;
            for note in printed.left_out {
                program.say(&format!("note   {note}"));
            }
            return Ok(CommandOutcome::Done);
        }
        QueryFormat::Csv => print::csv(&answer),
        QueryFormat::Json => print::json_lines(&answer),
        QueryFormat::Parquet => print::parquet(&mut answer),
    };
    report::data(&bytes.map_err(|err| CommandError::failed(err, None))?)?;
    Ok(CommandOutcome::Done)
}
