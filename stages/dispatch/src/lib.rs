//! Sends accepted motions to a robot cell and records their outcomes.
//!
//! ```toml
//! [stages.dispatch]
//! kind = "dispatch"
//! inputs.rollouts = "screen.rollouts"
//! inputs.robustness = "screen.robustness"
//! inputs.candidates = "refine.candidates"
//! inputs.objects = "ingest.objects"
//! cell = "simulated"
//! ```
//!
//! The protocol and the simulated cell are in crate `cell`; this stage selects the motions, sends
//! them to the cell, and writes the table `executions` and one recording per executed motion. Its
//! [`report`] computes success rates. Crate `planning` turns motions into goals; an
//! infeasible motion is refused, and its row in `executions` says why. No hardware moves without
//! `execute = true`. A goal without an answer, or with one that fails its checks, ends the run: the
//! next run queries its outcome before it sends another, and never sends the motion under another
//! goal id. Motions stopped by a person are counted separately and sent again only on request.

mod config;
mod connect;
mod dispatch;
mod error;
mod goals;
mod in_flight;
mod ledger;
mod names;
mod protocol_4;
mod recording;
mod refusal;
pub mod report;
mod robots;
mod rows;
mod send_queue;
mod sender;

pub use config::{AfterUnknown, DispatchConfig, SIMULATED, SendOrder, SimulatedConfig};
pub use connect::simulated_cell;
pub use dispatch::{Dispatch, DispatchMetrics};
pub use error::{ControllerMismatch, DispatchError};
pub use in_flight::{Cancellation, MotionInFlight, stop_sending};
