//! `executions`: outcomes of the motions sent to a robot cell, one partition per object, one row
//! per motion.

use crate::{
    columns::{columns, words},
    table::table,
};

columns! {
    /// The outcome of one motion at a cell.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Execution {
        /// Empty if the motion was refused before anything was sent.
        goal_id: String => "the goal's name on the wire",
        candidate_id: String => "the motion",
        cell: String => "the cell's name",
        simulated: bool => "whether the cell says that nothing real moves",
        /// Empty if it was not asked.
        gap: String => "how it differs from what was planned for, as it says",
        accepted: bool => "whether the cell took the goal",
        outcome: Outcome => "how it ended",
        message: String => "the cell's word on it",
        duration_s: f64 ["s"] => "length of the motion as executed",
        tracking_error_rad: f64 ["rad"]
            => "largest difference of a measured joint position from its command",
        lift_m: f64 ["m"] => "rise of the object as the cell measured it",
    }
}

/// The outcomes of the motions for one object.
pub type Executions = Vec<Execution>;
table! {"executions", 3, per "object", rows: Execution}

words! {
    /// Outcome of an execution.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Outcome: "outcome" {
        /// The object was lifted and held.
        Succeeded = "succeeded",
        /// The motion was executed and the object not held.
        Failed = "failed",
        /// The cell aborted the motion.
        Aborted = "aborted",
        /// The outcome is unknown; a person has to check.
        Unknown = "unknown",
        /// The cell refused the goal; nothing moved.
        Rejected = "rejected",
        /// A person canceled the motion.
        Stopped = "stopped",
    }
}
