//! From the command line to an exit code.

use std::{env, ffi::OsString, fmt::Display, path::PathBuf, process::ExitCode};

use clap::FromArgMatches;
use dataflow::Kind;
use rustix::process::Signal;

use crate::{
    arguments::{Cli, Command},
    commands,
    invocation::{self, Invocation},
    label::Label,
    memory,
    outcome::CommandOutcome,
    progress::Quiet,
    report,
};

/// Variable of the environment of a process that is to end, as at Ctrl-C, when the process that started it ends.
pub const ENDS_WITH_PARENT: &str = "PIPELINE_ENDS_WITH_PARENT";

/// The context of every command.
pub(crate) struct Program<'a> {
    /// The kinds of stages that pipeline files may name.
    pub(crate) kinds: &'a [Kind],
    /// The lake's folder.
    pub(crate) lake: PathBuf,
    /// Whether only errors are printed.
    pub(crate) quiet: Quiet,
}

impl Program<'_> {
    /// Prints a line for people, unless only errors are printed.
    pub(crate) fn say(&self, label: Label, text: impl Display) {
        if self.quiet == Quiet::No {
            report::line(label, text);
        }
    }

    /// Prints text for people, unless only errors are printed.
    pub(crate) fn say_plain(&self, text: &str) {
        if self.quiet == Quiet::No {
            report::plain(text);
        }
    }
}

/// Reads the arguments.
fn arguments() -> Result<Cli, clap::Error> {
    let mut command = Cli::described();
    command.build();
    // It works, but its line would not fit on one screen.
    let mut command = command.mut_subcommand("help", |help| help.hide(true));
    let mut matches = command.try_get_matches_from_mut(invocation::words())?;
    Cli::from_arg_matches_mut(&mut matches).map_err(|err| err.format(&mut command))
}

/// Executes the arguments of a command line, the program's name first, in a process that another program started;
/// `executable` starts this program as a process of its own. Returns the exit code as [`command_line`] does.
pub fn command_line_of(executable: PathBuf, words: Vec<OsString>, kinds: &[Kind]) -> u8 {
    let name = words.first().map(|name| name.to_string_lossy());
    lake::name_program(&name.unwrap_or_default());
    invocation::set(Invocation { executable, words });
    execute(kinds)
}

/// Executes the process's arguments with these kinds of stages, and returns the exit code: 0 done,
/// 1 failed, 2 wrong command line or pipeline file, 3 done with skipped items, 130 interrupted.
pub fn command_line(kinds: &[Kind]) -> ExitCode {
    ExitCode::from(execute(kinds))
}

fn execute(kinds: &[Kind]) -> u8 {
    invocation::set_program();
    if env::var_os(ENDS_WITH_PARENT).is_some() {
        let _it_has_none = rustix::process::set_parent_process_death_signal(Some(Signal::INT));
    }
    let cli = match arguments() {
        Ok(cli) => cli,
        Err(said) => return report::arguments(&said),
    };
    let program = Program {
        kinds,
        lake: cli.lake,
        quiet: if cli.quiet { Quiet::Yes } else { Quiet::No },
    };
    let result = memory::check(&cli.command).and_then(|()| match &cli.command {
        Command::New(args) => commands::new(&program, args),
        Command::Run(args) => commands::run(&program, args),
        Command::Attach(args) => commands::attach(&program, args),
        Command::Plan(args) => commands::plan(&program, args),
        Command::Query(args) => commands::query(&program, args),
        Command::Inspect(args) => commands::inspect(&program, args),
        Command::Report(args) => commands::report(&program, args),
        Command::Export(args) => commands::export(&program, args),
        Command::Runs(args) => commands::runs(&program, args),
        Command::Diff(args) => commands::diff(&program, args),
        Command::Lineage(args) => commands::lineage(&program, args),
        Command::Tag(args) => commands::tag(&program, args),
        Command::Untag(args) => commands::untag(&program, args),
        Command::Stages(args) => commands::stages(&program, args),
        Command::Graph(args) => commands::graph(&program, args),
        Command::Doctor(args) => commands::doctor(&program, args),
        Command::Calibrate(args) => commands::calibrate(&program, args),
        Command::Cell(args) => commands::cell(&program, args),
        Command::Router(args) => commands::router(&program, args),
        Command::Verify(args) => commands::verify(&program, args),
        Command::Gc(args) => commands::gc(&program, args),
        Command::Push => commands::push(&program),
        Command::Pull(args) => commands::pull(&program, args),
        Command::Unit(args) => commands::unit(&program, args),
        Command::Completions(args) => commands::completions(args),
    });
    let code = result.map_or_else(|err| report::print_error(&err), CommandOutcome::code);
    let left = cli
        .detached_in
        .map(|folder| commands::leave_code(&folder, code));
    match left {
        Some(Err(err)) => report::print_error(&err),
        _ => code,
    }
}
