//! `executions`: what a robot cell did with the motions sent to it, one partition per object, one row
//! per motion.
//!
//! | column              | type | unit | meaning                                                          |
//! |---------------------|------|------|------------------------------------------------------------------|
//! | `goal_id`           | utf8 |      | the goal's name on the wire; empty if nothing was sent           |
//! | `candidate_id`      | utf8 |      | the motion                                                       |
//! | `cell`              | utf8 |      | the cell's name                                                  |
//! | `simulated`         | bool |      | whether the cell says that nothing real moves                    |
//! | `gap`               | utf8 |      | how it differs from what was planned for, as it says             |
//! | `accepted`          | bool |      | whether the cell took the goal                                   |
//! | `outcome`           | utf8 |      | `succeeded`, `failed`, `rejected`, `aborted`, `stopped`, `unknown` |
//! | `message`           | utf8 |      | the cell's word on it                                            |
//! | `duration_s`        | f64  | s    | length of the motion as executed                                 |
//! | `tracking_error_rad`| f64  | rad  | largest difference of a measured joint position from its command |
//! | `lift_m`            | f64  | m    | rise of the object as the cell measured it                       |

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "executions/3";

/// What a cell did with one motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Execution {
    /// The goal's name on the wire; empty if the motion was refused before anything was sent.
    pub goal_id: String,
    /// The motion.
    pub candidate_id: String,
    /// The cell's name, e.g. `simulated`.
    pub cell: String,
    /// Whether the cell says that nothing real moves.
    pub simulated: bool,
    /// How the cell differs from what was planned for, as it says; empty if it was not asked.
    pub gap: String,
    /// Whether the cell took the goal.
    pub accepted: bool,
    /// How it ended.
    pub outcome: Outcome,
    /// The cell's word on it.
    pub message: String,
    /// Length of the motion as executed, in seconds.
    pub duration_s: f64,
    /// Largest difference of a measured joint position from its command, in radians.
    pub tracking_error_rad: f64,
    /// Rise of the object as the cell measured it, in meters.
    pub lift_m: f64,
}

/// How an execution ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The object was lifted and held.
    Succeeded,
    /// The motion was executed and the object not held.
    Failed,
    /// The cell refused the goal; nothing moved.
    Rejected,
    /// The cell broke the motion off.
    Aborted,
    /// A person had the motion broken off.
    Stopped,
    /// Nobody knows; a person has to look.
    Unknown,
}

impl Outcome {
    /// Every outcome.
    pub const ALL: [Self; 6] = [
        Self::Succeeded,
        Self::Failed,
        Self::Rejected,
        Self::Aborted,
        Self::Stopped,
        Self::Unknown,
    ];

    /// Returns the word stored in column `outcome`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Rejected => "rejected",
            Self::Aborted => "aborted",
            Self::Stopped => "stopped",
            Self::Unknown => "unknown",
        }
    }

    /// Reads the word stored in column `outcome`.
    pub fn parse(word: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|outcome| outcome.as_str() == word)
    }
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(executions: &[Execution]) -> Columns {
    let rows = || executions.iter();
    let mut c = Columns::new(VERSION);
    c.utf8(
        "goal_id",
        "the goal's name on the wire",
        rows().map(|e| e.goal_id.clone()),
    );
    c.utf8(
        "candidate_id",
        "the motion",
        rows().map(|e| e.candidate_id.clone()),
    );
    c.utf8("cell", "the cell's name", rows().map(|e| e.cell.clone()));
    c.bool(
        "simulated",
        "whether the cell says that nothing real moves",
        rows().map(|e| e.simulated),
    );
    c.utf8(
        "gap",
        "how it differs from what was planned for, as it says",
        rows().map(|e| e.gap.clone()),
    );
    c.bool(
        "accepted",
        "whether the cell took the goal",
        rows().map(|e| e.accepted),
    );
    c.utf8(
        "outcome",
        "how it ended",
        rows().map(|e| e.outcome.as_str().to_owned()),
    );
    c.utf8(
        "message",
        "the cell's word on it",
        rows().map(|e| e.message.clone()),
    );
    c.f64(
        "duration_s",
        "s",
        "length of the motion as executed",
        rows().map(|e| e.duration_s),
    );
    c.f64(
        "tracking_error_rad",
        "rad",
        "largest difference of a measured joint position from its command",
        rows().map(|e| e.tracking_error_rad),
    );
    c.f64(
        "lift_m",
        "m",
        "rise of the object as the cell measured it",
        rows().map(|e| e.lift_m),
    );
    c
}

/// Returns one row per motion; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(executions: &[Execution]) -> Result<RecordBatch, SchemaError> {
    columns(executions).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version or hold an unknown outcome.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Execution>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    (0..r.rows())
        .map(|row| {
            let word = r.utf8("outcome", row)?;
            Ok(Execution {
                goal_id: r.utf8("goal_id", row)?.to_owned(),
                candidate_id: r.utf8("candidate_id", row)?.to_owned(),
                cell: r.utf8("cell", row)?.to_owned(),
                simulated: r.bool("simulated", row)?,
                gap: r.utf8("gap", row)?.to_owned(),
                accepted: r.bool("accepted", row)?,
                outcome: Outcome::parse(word)
                    .ok_or_else(|| r.invalid("outcome", format!("`{word}` is no outcome")))?,
                message: r.utf8("message", row)?.to_owned(),
                duration_s: r.f64("duration_s", row)?,
                tracking_error_rad: r.f64("tracking_error_rad", row)?,
                lift_m: r.f64("lift_m", row)?,
            })
        })
        .collect()
}

/// The rows of one partition.
pub type Executions = Vec<Execution>;

impl Table for Executions {
    const NAME: &'static str = "executions";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch)
    }
}
