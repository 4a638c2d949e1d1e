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
//! cell, and writes the table `executions` and one recording per motion executed. How often motions succeed
//! says crate `report-dispatch`.
//! Crate `planning` makes goals of motions; one that the robot cannot make is refused, and its row in
//! `executions` says why.
//! Nothing real moves without `execute = true`. A goal of which nothing is heard, or nothing that can be
//! believed, ends the run: the next one asks the cell what came of it before it sends another, and never
//! sends it under another name.
//! A motion that a person stopped is counted apart and sent again only where that is asked for.

mod cells;
mod config;
mod error;
mod goals;
mod in_flight;
mod journal;
mod names;
mod recording;
mod refusal;
mod robots;
mod stage;

pub use cells::simulated_cell;
pub use config::{DispatchConfig, SimulatedConfig};
pub use error::DispatchError;
pub use in_flight::{Cancellation, MotionInFlight, stop_sending};
pub use stage::{Dispatch, DispatchMetrics};
