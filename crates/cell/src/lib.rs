//! The dispatch protocol over zenoh: goals and outcomes, a client, a server for any machine, and a simulated cell.
//!
//! A robot cell takes one [`Goal`] at a time, executes it and reports its measurements.
//! [`CellClient`] is the dispatcher's side, [`CellServer`] the cell's side for any [`Machine`], and
//! [`SimulatedCell`] a cell backed by physics alone. This crate's `README.md` specifies the protocol
//! between them on one page, so that any lab can serve it.
//!
//! - Goals and results are queries with replies, never bare publications: a missing answer is
//!   always detected.
//! - A goal's id is derived from its content. A cell that is asked twice answers twice and moves
//!   once. Its [`Address`] names the one cell and journal that may execute it, and whether anything
//!   real may move.
//! - The dispatcher signs its goals. The cell signs its answers, and the bytes that they answer, with
//!   its journal's key; an answer counts only if no other party answers too. A report is used only
//!   after it has been checked against its goal and itself ([`UncheckedReport`]).
//! - Publications (states, motions, outcomes) are for monitoring. The report repeats every sample,
//!   so nothing depends on a lossy stream. States and outcomes are numbered, and a [`Watcher`]
//!   requests those that it missed.
//! - The only clock times in messages are a goal's send time and start deadline. They are not part
//!   of the goal: equal goals to a simulated cell give equal reports.
//! - A cell journals a goal before it acknowledges it. A restarted cell knows what it did, and
//!   reports a motion interrupted by a crash as unknown.
//! - Sessions do no scouting. Traffic that leaves this machine uses TLS, to and from the peers that
//!   an [`Access`] file names.

mod acceptance;
mod access;
mod capabilities;
mod cell_robot;
mod client;
mod contradiction;
mod error;
mod goal;
mod grasp;
mod heartbeat;
mod keys;
mod machine;
mod message;
mod outcome;
mod pacer;
mod points;
mod rejection;
mod report;
mod ros2;
mod router;
mod server;
mod session;
mod signature;
mod simulated;
mod state;
mod terms;
mod text;
mod tls;
mod watch;
mod wire;

pub use acceptance::check_palm;
pub use access::{Access, AccessFault};
pub use capabilities::{
    Capabilities, CapabilityChange, ControllerInfo, PalmLimitFault, PalmLimits,
};
pub use cell_robot::{CellArm, CellRobot};
pub use client::{CellClient, ControlReply, GoalResult, Patience, RecoveryResult, SendRecord};
pub use contradiction::Contradiction;
pub use error::{Cause, CellError, RecordError, Transmission, with_causes};
pub use goal::{EncodedGoal, Goal};
pub use grasp::{Approach, Grasp};
pub use keys::Keys;
pub use machine::{Machine, MachineDescription};
pub use message::{Address, CLOCKS_MS, GoalMessage};
pub use motion::{JointPoint, JointRates, JointTrack, PalmPoint, PalmTrajectory};
pub use outcome::GoalOutcome;
pub use pacer::Pacer;
pub use rejection::{Rejection, RejectionCode};
pub use report::{Ending, Report, Sample, UncheckedReport};
pub use ros2::{Ros2Node, Ros2Publisher, Ros2Subscriber, Urgency, ros2_now_ns};
pub use router::Router;
pub use server::{
    Abort, CellServer, Fault, MonitoredMotion, OutcomeListener, PlannedFault, ServerConfig,
    ServiceConfig, Tick, TickListener,
};
pub use session::{check_endpoint, subscribe};
pub use signature::{Acceptance, PublicKey, SigningKey};
pub use simulated::{
    ModelMismatch, ObjectFinder, SimulatedCell, SimulatedCellConfig, execute_offline,
};
pub use state::State;
pub use terms::Terms;
pub use text::escaped;
pub use tls::TlsFault;
pub use watch::{Counts, WatchEvent, Watcher};
pub use wire::{StateHeader, WireError, robot_digest};

/// Protocol version; a cell refuses goals of any other version.
pub const PROTOCOL: u32 = 5;
