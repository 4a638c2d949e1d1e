//! `pipeline run --detach` and `pipeline attach`: runs that go on when the terminal is gone.
//!
//! Each has a folder `detached/N` in the lake, with what it says (`log`, locked while it runs), the number of
//! its process (`process`) and its exit code (`code`).

use std::{
    fs,
    fs::{File, TryLockError},
    io::{self, ErrorKind, Read, Write},
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use signal_hook::{consts::SIGINT, iterator::Signals};

use crate::{
    arguments::AttachArgs,
    command_line::Program,
    interrupt::INTERRUPTED,
    invocation,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Time in which a run that cannot begin, or has nothing to do, ends.
const BEGIN: Duration = Duration::from_secs(1);

/// Time between two looks at a log.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Ended runs whose logs are kept.
const KEPT: usize = 20;

/// Starts this process's own command again, in the background.
pub(crate) fn detach(program: &Program) -> Result<CommandOutcome, CommandError> {
    let lake = std::path::absolute(&program.lake).map_err(|err| CommandError::failed(err, None))?;
    let (number, folder) = new_folder(&lake)?;
    let mut child = start(&folder).map_err(failed(&folder))?;
    let until = Instant::now() + BEGIN;
    while Instant::now() < until {
        if let Some(status) = child.try_wait().map_err(failed(&folder))? {
            show(&folder, || false)?;
            fs::remove_dir_all(&folder).map_err(failed(&folder))?;
            let code = status.code().and_then(|code| u8::try_from(code).ok());
            return Ok(code.map_or(CommandOutcome::ExitCode(1), CommandOutcome::ExitCode));
        }
        thread::sleep(LOOK_EVERY);
    }
    program.say(
        Label::Detach,
        format!(
            "run goes on as process {}; `kill {}` stops it as Ctrl-C would",
            child.id(),
            child.id()
        ),
    );
    program.say(Label::Next, format!("`pipeline attach {number}`"));
    Ok(CommandOutcome::Done)
}

/// Shows what a detached run says until it ends, and ends as it does.
pub(crate) fn attach(program: &Program, args: &AttachArgs) -> Result<CommandOutcome, CommandError> {
    // Where a shell's background job ignores Ctrl-C, too.
    let mut signals = Signals::new([SIGINT]).map_err(|err| CommandError::failed(err, None))?;
    let mut there = folders(&program.lake)?;
    let known = || {
        let known: Vec<String> = there.iter().map(|(number, _)| number.to_string()).collect();
        known.join(", ")
    };
    let chosen = match args.number {
        Some(number) => there
            .iter()
            .position(|(it, _)| *it == number)
            .ok_or_else(|| {
                CommandError::usage(
                    format!("no detached run {number} in `{}`", program.lake.display()),
                    format!("known are: {}", known()),
                )
            })?,
        None => there.len().checked_sub(1).ok_or_else(|| {
            CommandError::usage(
                format!("no run was detached in `{}`", program.lake.display()),
                "start one with `pipeline run pipelines/cgf.toml --detach`",
            )
        })?,
    };
    let (number, folder) = there.swap_remove(chosen);
    if let Ok(process) = fs::read_to_string(folder.join("process")) {
        program.say(
            Label::Attach,
            format!(
                "run {number}, process {}; Ctrl-C leaves it alone",
                process.trim()
            ),
        );
    }
    if !show(&folder, || signals.pending().next().is_some())? {
        program.say(Label::Left, format!("run {number} goes on"));
        return Ok(CommandOutcome::ExitCode(INTERRUPTED));
    }
    let code = fs::read_to_string(folder.join("code")).ok();
    let code = code.and_then(|code| code.trim().parse().ok());
    code.map(CommandOutcome::ExitCode).ok_or_else(|| {
        CommandError::failed(
            anyhow::anyhow!("the run has ended without an exit code: it was interrupted or killed"),
            Some("the same `run` goes on from what was made".to_owned()),
        )
    })
}

/// Leaves the exit code of a detached run.
pub(crate) fn leave_code(folder: &Path, code: u8) -> Result<(), CommandError> {
    Ok(lake::write_atomic(
        &folder.join("code"),
        format!("{code}\n").as_bytes(),
    )?)
}

fn start(folder: &Path) -> io::Result<Child> {
    let log = File::create(folder.join("log"))?;
    // As long as the process has it open.
    log.lock()?;
    let child = Command::new(invocation::executable()?)
        .arg("--detached-in")
        .arg(folder)
        .args(
            invocation::words()
                .into_iter()
                .skip(1)
                .filter(|word| word != "--detach"),
        )
        .stdin(Stdio::null())
        .stdout(log.try_clone()?)
        .stderr(log)
        // Not that of the terminal, whose Ctrl-C it does not get.
        .process_group(0)
        .spawn()?;
    let mut process = File::create_new(folder.join("process"))?;
    writeln!(process, "{}", child.id())?;
    Ok(child)
}

/// Makes the folder of a new detached run, and removes those of the oldest that have ended.
fn new_folder(lake: &Path) -> Result<(u32, PathBuf), CommandError> {
    let there = folders(lake)?;
    for (_, folder) in there.iter().rev().skip(KEPT) {
        if has_ended(&File::open(folder.join("log")).map_err(failed(folder))?)
            .map_err(failed(folder))?
        {
            fs::remove_dir_all(folder).map_err(failed(folder))?;
        }
    }
    let mut number = there.last().map_or(1, |(number, _)| number + 1);
    let parent = lake.join("detached");
    fs::create_dir_all(&parent).map_err(failed(&parent))?;
    loop {
        let folder = parent.join(number.to_string());
        match fs::create_dir(&folder) {
            Ok(()) => return Ok((number, folder)),
            // Another has been faster.
            Err(err) if err.kind() == ErrorKind::AlreadyExists => number += 1,
            Err(err) => return Err(failed(&folder)(err)),
        }
    }
}

/// The folders of a lake's detached runs by their numbers, in order.
fn folders(lake: &Path) -> Result<Vec<(u32, PathBuf)>, CommandError> {
    let parent = lake.join("detached");
    let entries = match fs::read_dir(&parent) {
        Err(err) if err.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(failed(&parent))?,
    };
    let mut there = Vec::new();
    for entry in entries {
        let entry = entry.map_err(failed(&parent))?;
        let number = entry.file_name().to_string_lossy().parse();
        // One without a log is being made at this moment.
        if let Ok(number) = number
            && entry.path().join("log").exists()
        {
            there.push((number, entry.path()));
        }
    }
    there.sort_unstable();
    Ok(there)
}

/// Copies a log to stdout until its run has ended or nobody looks any more; returns whether it has ended.
fn show(folder: &Path, mut is_left: impl FnMut() -> bool) -> Result<bool, CommandError> {
    let mut log = File::open(folder.join("log")).map_err(failed(folder))?;
    loop {
        // Before what is left is read.
        let is_over = has_ended(&log).map_err(failed(folder))?;
        let mut said = Vec::new();
        log.read_to_end(&mut said).map_err(failed(folder))?;
        report::data(&said)?;
        if is_over || is_left() {
            return Ok(is_over);
        }
        thread::sleep(LOOK_EVERY);
    }
}

/// Whether no process has a log open that was started with it.
fn has_ended(log: &File) -> io::Result<bool> {
    match log.try_lock_shared() {
        Ok(()) => log.unlock().map(|()| true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(err)) => Err(err),
    }
}

fn failed(path: &Path) -> impl Fn(io::Error) -> CommandError {
    let path = path.display().to_string();
    move |err| {
        let message = format!("cannot use `{path}`");
        CommandError::failed(anyhow::Error::from(err).context(message), None)
    }
}
