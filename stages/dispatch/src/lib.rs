//! Sends accepted motions to a robot cell and keeps what it did with them.
//!
//! ```toml
//! [stages.dispatch]
//! kind = "dispatch"
//! inputs.rollouts = "screen.rollouts"
//! inputs.candidates = "sample.candidates"
//! inputs.objects = "ingest.objects"
//! cell = "simulated"
//! ```
//!
//! The protocol and the simulated cell are in crate `cell`; this stage chooses the motions, asks the
//! cell, and writes the table `executions` and one recording per motion executed.
//! Nothing real moves without `execute = true`. A goal of which nothing is heard ends the run: the next
//! one asks the cell what came of it before it sends another, and never sends it under another name.

mod cells;
mod config;
mod error;
mod goals;
mod journal;
mod recording;
mod stage;

pub use cells::simulated_cell;
pub use config::{DispatchConfig, SimulatedConfig};
pub use error::DispatchError;
pub use stage::Dispatch;
