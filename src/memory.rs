//! The address space that a limit (`ulimit -v`) leaves to the program.

use std::{
    fmt,
    fs::File,
    io::{Read, Write},
    panic, thread,
};

use rustix::process::{Resource, getrlimit};

use crate::{arguments::Command, invocation, outcome::CommandError};

const MB: u64 = 1_000_000;
/// Address space for the tables and stages of a command that computes, beside what the program takes itself.
const COMPUTING: u64 = 150 * MB;
/// The same for a command that only reads.
const READING: u64 = 20 * MB;
/// What is allocated before a command begins.
const BEGUN: u64 = 6 * MB;
/// Address space of a thread that computes: its stack, and the memory that the allocator keeps for it.
const THREAD: u64 = 64 * MB;
/// Address space of the thread that answers a query, with its stack.
const QUERY: u64 = 300 * MB;
/// What libraries panic with where no thread can be started.
const NO_THREAD: [&str; 4] = [
    "Resource temporarily unavailable",
    "Cannot allocate memory",
    "failed to spawn thread",
    "can't spawn worker",
];
/// Largest allocation whose failure ends the program: more may be asked for in vain by who can do without.
const ORDINARY: usize = 1 << 30;

/// Returns the number of threads that compute: as many as processors, or as the address space allows.
pub fn threads() -> usize {
    let processors = thread::available_parallelism().map_or(1, Into::into);
    let Some((limit, taken)) = limit().zip(taken()) else {
        return processors;
    };
    let fit = limit.saturating_sub(taken + COMPUTING) / THREAD;
    usize::try_from(fit)
        .unwrap_or(usize::MAX)
        .clamp(1, processors)
}

/// Checks that the address space suffices for a command to begin. From here on, a thread that cannot be had ends
/// the program as memory does.
pub(crate) fn check(command: &Command) -> Result<(), CommandError> {
    let Some((limit, taken)) = limit().zip(taken()) else {
        return Ok(());
    };
    let needed = taken
        + match command {
            Command::Run(_) | Command::Unit(_) | Command::Cell(_) | Command::Router(_) => {
                COMPUTING + THREAD
            }
            Command::Query(_) => COMPUTING + 3 * THREAD + QUERY,
            _ => READING,
        };
    if needed > limit {
        return Err(CommandError::failed(
            anyhow::anyhow!(
                "too little memory: `ulimit -v` allows {} MB of address space, and at least {} MB are needed",
                limit / MB,
                needed.div_ceil(MB)
            ),
            Some("allow more, or all, with `ulimit -v unlimited`".to_owned()),
        ));
    }
    let before = panic::take_hook();
    panic::set_hook(Box::new(move |panicked| {
        end_if_without_thread(panicked);
        before(panicked);
    }));
    Ok(())
}

/// Ends the program if a panic is of a thread that could not be started; another program that holds this one goes on.
pub(crate) fn end_if_without_thread(panicked: &panic::PanicHookInfo<'_>) {
    if !invocation::is_program() {
        return;
    }
    let text = panicked.to_string();
    if NO_THREAD.iter().any(|part| text.contains(part)) {
        end_without_thread();
    }
}

/// Ends the program because a thread could not be started.
pub(crate) fn end_without_thread() -> ! {
    end(format_args!("a thread"))
}

/// Ends the program if an ordinary allocation has failed. Nothing is allocated here.
pub fn out_of_memory(bytes: usize) {
    if bytes <= ORDINARY {
        end(format_args!("{bytes} bytes"));
    }
}

/// Says what cannot be had, and ends the program. Nothing is allocated here.
fn end(what: fmt::Arguments<'_>) -> ! {
    let mut text = [0; 400];
    let mut left = text.as_mut_slice();
    let _written = match limit() {
        Some(limit) => writeln!(
            left,
            "error: out of memory: {what} more cannot be had; `ulimit -v` allows {} MB of address space\n\
             hint: allow more, or all, with `ulimit -v unlimited`; what is made so far is kept",
            limit / MB
        ),
        None => writeln!(
            left,
            "error: out of memory: {what} more cannot be had\n\
             hint: end other programs, or use fewer threads with `--jobs 1`; what is made so far is kept"
        ),
    };
    let n_left = left.len();
    let said = text.len() - n_left;
    let _written = std::io::stderr().write_all(text.get(..said).unwrap_or_default());
    signal_hook::low_level::exit(1);
}

/// The limit of the address space in bytes, if there is one.
fn limit() -> Option<u64> {
    getrlimit(Resource::As).current
}

/// The address space of the program itself, in bytes: its code, and what it has allocated before anything begins.
/// What the allocator has reserved meanwhile is there to be used.
fn taken() -> Option<u64> {
    let mut text = [0; 128];
    let n = File::open("/proc/self/statm").ok()?.read(&mut text).ok()?;
    let text = std::str::from_utf8(text.get(..n)?).ok()?;
    let mut pages = text
        .split(' ')
        .map(|number| number.trim().parse::<u64>().ok());
    let (all, data) = (pages.next()??, pages.nth(4)??);
    let page = u64::try_from(rustix::param::page_size()).ok()?;
    Some(all.checked_sub(data)?.checked_mul(page)? + BEGUN)
}
