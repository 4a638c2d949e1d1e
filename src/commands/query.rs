//! `pipeline query`

mod artifacts;
mod cells;
mod faults;
pub(super) mod page;
mod print;
mod question;
mod source;
mod tables;

use lake::Lake;

use self::{page::Page, source::Source, tables::Tables};
use crate::{
    arguments::{QueryArgs, QueryFormat},
    command_line::Program,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Answers a question in SQL over the lake's tables.
pub(crate) fn query(program: &Program, args: &QueryArgs) -> Result<CommandOutcome, CommandError> {
    question::check(&args.sql)?;
    let lake = if args.depot {
        program.open_shared_lake()?
    } else {
        Lake::open(&program.lake)
    };
    let answered = answer(program, args, &lake);
    lake.leave();
    answered
}

fn answer(
    program: &Program,
    args: &QueryArgs,
    lake: &Lake,
) -> Result<CommandOutcome, CommandError> {
    // What is found here is not collected before it is read.
    let _kept = lake.check_exists().is_ok().then(|| lake.block_collection());
    let source = if args.depot {
        Source::Depot(lake.depot_tables()?)
    } else {
        let run = args.run.as_ref();
        let run = run.map(|name| lake.run(lake.find_run(name)?)).transpose()?;
        Source::Lake {
            lake,
            run: run.map(Box::new),
        }
    };
    let tables = Tables::open(source, &args.sql)?;
    if args.depot {
        program.say_shared(lake)?;
    }
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
