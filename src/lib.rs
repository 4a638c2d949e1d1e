//! The command line of `pipeline`: the only code that prints, exits, or knows every stage.
//!
//! It is a library so that a program with stages of its own has the same commands:
//!
//! ```no_run
//! let kinds = pipeline::kinds();
//! // kinds.push(dataflow::Kind::of::<MyStage>(dataflow::code!("my-stage")));
//! pipeline::command_line(&kinds);
//! ```

mod arguments;
mod batch;
mod command_line;
mod commands;
mod executors;
mod heartbeats;
mod interrupt;
mod invocation;
mod jobs;
mod kinds;
mod label;
mod library;
mod memory;
mod numbers;
mod outages;
mod outcome;
mod processes;
mod progress;
mod report;
mod sample;
mod sharing;
mod system_errors;
mod timestamps;

#[cfg(test)]
#[path = "../tests/simulation/histories.rs"]
mod simulation;

pub use command_line::{ENDS_WITH_PARENT, command_line, command_line_of};
pub use commands::Direction;
pub use kinds::kinds;
pub use library::{
    LineageOf, Refusal, Wanted, lineage, options_in, query, read_artifacts, stage_options,
};
pub use memory::{out_of_memory, threads};
