//! `pipeline query`

mod answer;
mod arithmetic;
mod artifacts;
mod engine;
mod faults;
mod files;
mod lists;
mod meaning;
mod membership;
pub(super) mod page;
mod precedence;
mod print;
mod quantile;
mod question;
mod scan;
mod source;
mod tables;
mod texts;
mod truths;
mod unknown;
mod value_text;
mod values;

use std::{
    fs, panic,
    path::Path,
    sync::{
        Once,
        atomic::{AtomicBool, Ordering},
    },
    thread,
};

use datafusion::arrow::array::RecordBatch;
use lake::Lake;

use self::{page::Page, question::Question, source::Source, tables::Tables};
use crate::{
    arguments::{QueryArgs, QueryFormat},
    command_line::Program,
    invocation,
    label::Label,
    memory,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Stack of the thread that answers: each link of a chain of operators lies within the next.
const STACK_BYTES: usize = 256 << 20;
/// Whether the last panic was one of this program, not of the engine.
static IS_OWN_PANIC: AtomicBool = AtomicBool::new(false);

/// Answers a question in SQL over the lake's tables.
pub(crate) fn query(program: &Program, args: &QueryArgs) -> Result<CommandOutcome, CommandError> {
    with_large_stack(|| ask(program, args))
}

/// Returns the rows that answer a question over the tables of the lake in this folder, of one run or of the newest.
pub(crate) fn rows(lake: &Path, sql: &str, run: Option<&str>) -> Result<RecordBatch, CommandError> {
    with_large_stack(|| {
        let question = Question::read(sql)?;
        let lake = Lake::open(lake);
        let answered = {
            let _kept = kept(&lake);
            look_up(&lake, &question, run).and_then(|tables| tables.answer(question))
        };
        lake.leave();
        answered
    })
}

/// Blocks garbage collection: what is found is not collected before it is read.
fn kept(lake: &Lake) -> Option<fs::File> {
    lake.check_exists()
        .ok()
        .and_then(|()| lake.block_collection())
}

fn look_up<'a>(
    lake: &'a Lake,
    question: &Question,
    run: Option<&str>,
) -> Result<Tables<'a>, CommandError> {
    let run = run.map(|name| lake.run(lake.find_run(name)?)).transpose()?;
    let source = Source::Lake {
        lake,
        run: run.map(Box::new),
    };
    Tables::open(source, question)
}

/// Answers in a thread that can follow long chains of operators. The engine panics at some questions: they are
/// refused. A panic of this program is a fault.
fn with_large_stack<T: Send>(
    answer: impl FnOnce() -> Result<T, CommandError> + Send,
) -> Result<T, CommandError> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |panicked| {
            memory::end_if_without_thread(panicked);
            // Paths of the workspace are relative.
            let is_own = panicked
                .location()
                .is_some_and(|place| Path::new(place.file()).is_relative());
            IS_OWN_PANIC.store(is_own, Ordering::Relaxed);
            if is_own {
                before(panicked);
            }
        }));
    });
    thread::scope(|scope| {
        let asked = thread::Builder::new()
            .name("query".to_owned())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, answer);
        let asked = match asked {
            Ok(asked) => asked,
            Err(_) if invocation::is_program() => memory::end_without_thread(),
            Err(err) => {
                let hint = "end other programs, or raise the limit of threads (`ulimit -u`)";
                return Err(CommandError::failed(err, Some(hint.to_owned())));
            }
        };
        asked.join().unwrap_or_else(|panicked| {
            if IS_OWN_PANIC.load(Ordering::Relaxed) {
                panic::resume_unwind(panicked);
            }
            Err(faults::too_much())
        })
    })
}

fn ask(program: &Program, args: &QueryArgs) -> Result<CommandOutcome, CommandError> {
    let question = Question::read(&args.sql)?;
    let lake = if args.depot {
        program.open_shared_lake()?
    } else {
        Lake::open(&program.lake)
    };
    let answered = answer(program, args, question, &lake);
    lake.leave();
    answered
}

fn answer(
    program: &Program,
    args: &QueryArgs,
    question: Question,
    lake: &Lake,
) -> Result<CommandOutcome, CommandError> {
    let _kept = kept(lake);
    let mut tables = if args.depot {
        Tables::open(Source::Depot(lake.depot_tables()?), &question)?
    } else {
        look_up(lake, &question, args.run.as_deref())?
    };
    files::open(&question.files, lake.root(), &args.allow_files, &mut tables)?;
    if args.depot {
        program.say_shared(lake)?;
    }
    for (table, n) in &tables.collected {
        program.say(
            Label::Note,
            format!("{n} partitions of `{table}` were collected"),
        );
    }
    let answer = tables.answer(question)?;
    let bytes = match args.format {
        QueryFormat::Table => {
            let printed = print::table(&answer, Page::of_stdout());
            report::data(printed.text.as_bytes())?;
            for note in printed.left_out {
                program.say(Label::Note, note);
            }
            return Ok(CommandOutcome::Done);
        }
        QueryFormat::Csv => print::csv(&answer),
        QueryFormat::Json => print::json_lines(&answer),
        QueryFormat::Parquet => print::parquet(&answer),
    };
    report::data(&bytes.map_err(|err| CommandError::failed(err, None))?)?;
    Ok(CommandOutcome::Done)
}
