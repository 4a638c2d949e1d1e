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
//! Nothing real moves without `execute = true`; a goal of which nobody knows the outcome ends the
//! sending for its object and is listed as unknown, never repeated.

mod cells;
mod config;
mod error;
mod goals;
mod journal;
mod recording;
mod stage;

pub use config::{DispatchConfig, SimulatedConfig};
pub use error::DispatchError;
pub use stage::Dispatch;
