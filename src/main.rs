//! The command line of `pipeline`: the only code that prints, exits, or knows every stage.

mod arguments;
mod commands;
mod outcome;
mod progress;
mod registry;
mod report;

use std::process::ExitCode;

use clap::Parser;

use crate::{
    arguments::{Cli, Command},
    outcome::Outcome,
};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match &cli.command {
        Command::Run(args) => commands::run(&cli.lake, cli.quiet, args),
        Command::Plan(args) => commands::plan(&cli.lake, args),
        Command::Query(args) => commands::query(&cli.lake, args),
        Command::Inspect(args) => commands::inspect(&cli.lake, args),
        Command::Stages(args) => commands::stages(args),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::SkippedItems) => ExitCode::from(3),
        Err(trouble) => report::trouble(&trouble),
    }
}
