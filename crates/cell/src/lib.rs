//! The dispatch protocol over zenoh: goals and their outcomes, a client and a simulated cell.
//!
//! A robot cell takes one [`Goal`] at a time, executes it and reports what it measured.
//! [`CellClient`] is the dispatcher's side, [`SimulatedCell`] a cell made of physics alone; the
//! protocol between them is a page in this crate's `README.md`, so that any lab can serve it.
//!
//! - Goals and results are queries with replies, never bare publications: what was not answered is
//!   known to be unknown.
//! - A goal's id follows from its content. A cell asked twice answers twice and moves once.
//! - Answers are signed by the cell's journal, and one that anybody else gives too is none. A report is
//!   checked against its goal and itself before it is one ([`UncheckedReport`]).
//! - What a cell publishes (states, motions, outcomes) is for watching; the report holds every
//!   sample again, so that nothing depends on a stream that may lose some. States and outcomes are
//!   numbered, and a [`Watcher`] asks for those that it missed.
//! - The only clocks in messages say when a goal was sent and until when it may start, and are no part
//!   of the goal: equal goals to a simulated cell give equal reports.
//! - A cell writes down that it takes a goal before it says so. One that is started again knows what
//!   it did, and of the motion in which it went down that nobody knows.
//! - Sessions scout for nobody. What leaves this machine goes through TLS, to and from those whom an
//!   [`Access`] file names.

mod access;
mod capabilities;
mod client;
mod contradiction;
mod error;
mod goal;
mod heartbeat;
mod keys;
mod outcome;
mod pacer;
mod points;
mod report;
mod ros2;
mod router;
mod session;
mod signature;
mod simulated;
mod state;
mod watch;
mod wire;

pub use access::Access;
pub use capabilities::{Capabilities, Offer, PalmLimits};
pub use client::{CellClient, Executed, Halt, Recovered};
pub use contradiction::Contradiction;
pub use error::{Cause, CellError, with_causes};
pub use goal::{Goal, Rejection, RejectionCode, SealedGoal, Sending};
pub use keys::Keys;
pub use motion::{Carrier, JointPoint, JointRates, JointTrack, PalmPoint};
pub use outcome::GoalOutcome;
pub use pacer::Pacer;
pub use report::{Report, Sample, UncheckedReport};
pub use router::Router;
pub use session::{check_endpoint, subscribe};
pub use simulated::{
    BrokenOff, CellArm, Fault, Gap, ObjectError, ObjectFinder, OutcomeListener, PlannedFault,
    Service, SimulatedCell, SimulatedCellConfig, Tick, TickListener, rehearse,
};
pub use state::State;
pub use watch::{Counts, Seen, Watcher};
pub use wire::{StateHeader, WireError, robot_digest};

/// Version of the protocol; a cell refuses goals of any other.
pub const PROTOCOL: u32 = 4;
