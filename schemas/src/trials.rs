//! `trials`: how often the motions that a robot cell carried out succeeded, one partition for all objects,
//! one row per object and cell: the paper's table of real-world results, for any cell.
//!
//! | column                  | type | unit | meaning                                                     |
//! |-------------------------|------|------|-------------------------------------------------------------|
//! | `object`                | utf8 |      | the object                                                  |
//! | `cell`                  | utf8 |      | the cell's name                                             |
//! | `simulated`             | bool |      | whether the cell says that nothing real moves               |
//! | `gap`                   | utf8 |      | how it differs from what was planned for, as it says        |
//! | `trials_n`              | i64  |      | motions of which anything may have moved, but for those that a person stopped |
//! | `successes_n`           | i64  |      | those that lifted and held the object                       |
//! | `rate`                  | f64  | 1    | `successes_n` over `trials_n`; 0 of none                    |
//! | `rate_low`, `rate_high` | f64  | 1    | ends of its 95 % interval, see [`wilson`]                   |
//! | `failed_n`              | i64  |      | trials that ended without the object held                   |
//! | `aborted_n`             | i64  |      | trials that the cell broke off                              |
//! | `unknown_n`             | i64  |      | trials of which nobody knows the end: they count as none that succeeded |
//! | `rejected_n`            | i64  |      | motions that were not sent or not taken: no trials          |
//! | `stopped_n`             | i64  |      | motions that a person stopped: no trials                    |

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::{
    Table,
    columns::{Columns, Reader, SchemaError},
    executions::Outcome,
    success::wilson,
};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "trials/2";

/// What one cell made of the motions for one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Trials {
    /// The object's name.
    pub object: String,
    /// The cell's name.
    pub cell: String,
    /// Whether the cell says that nothing real moves.
    pub simulated: bool,
    /// How the cell differs from what was planned for, as it says.
    pub gap: String,
    /// How many motions ended in each way, in the order of [`Outcome::ALL`].
    pub outcomes_n: [i64; Outcome::ALL.len()],
}

impl Trials {
    /// Returns how many motions ended so.
    pub fn count(&self, outcome: Outcome) -> i64 {
        let mut counts = Outcome::ALL.iter().zip(self.outcomes_n);
        let found = counts.find(|(known, _)| **known == outcome);
        found.map_or(0, |(_, n)| n)
    }

    /// Returns how many motions may have moved anything and were not stopped by a person.
    pub fn trials_n(&self) -> i64 {
        let others = [Outcome::Rejected, Outcome::Stopped].map(|outcome| self.count(outcome));
        self.outcomes_n.iter().sum::<i64>() - others.iter().sum::<i64>()
    }

    /// Returns how many succeeded.
    pub fn successes_n(&self) -> i64 {
        self.count(Outcome::Succeeded)
    }

    /// Returns the share of the trials that succeeded, in 0..=1; 0 of none.
    pub fn rate(&self) -> f64 {
        self.successes_n() as f64 / self.trials_n().max(1) as f64
    }

    /// Returns the 95 % interval of that share.
    pub fn interval(&self) -> [f64; 2] {
        wilson(self.successes_n() as f64, self.trials_n() as f64)
    }
}

/// The outcomes that are no success, the columns that count them and their meanings.
const OTHERS: [(Outcome, &str, &str); 5] = [
    (
        Outcome::Failed,
        "failed_n",
        "trials that ended without the object held",
    ),
    (
        Outcome::Aborted,
        "aborted_n",
        "trials that the cell broke off",
    ),
    (
        Outcome::Unknown,
        "unknown_n",
        "trials of which nobody knows the end",
    ),
    (
        Outcome::Rejected,
        "rejected_n",
        "motions that were not sent or not taken: no trials",
    ),
    (
        Outcome::Stopped,
        "stopped_n",
        "motions that a person stopped: no trials",
    ),
];

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(trials: &[Trials]) -> Columns {
    let rows = || trials.iter();
    let mut c = Columns::new(VERSION);
    c.utf8("object", "the object", rows().map(|t| t.object.clone()));
    c.utf8("cell", "the cell's name", rows().map(|t| t.cell.clone()));
    c.bool(
        "simulated",
        "whether the cell says that nothing real moves",
        rows().map(|t| t.simulated),
    );
    c.utf8(
        "gap",
        "how it differs from what was planned for, as it says",
        rows().map(|t| t.gap.clone()),
    );
    c.i64(
        "trials_n",
        "motions of which anything may have moved, but for those that a person stopped",
        rows().map(Trials::trials_n),
    );
    c.i64(
        "successes_n",
        "those that lifted and held the object",
        rows().map(Trials::successes_n),
    );
    c.f64(
        "rate",
        "1",
        "share of the trials that succeeded; 0 of none",
        rows().map(Trials::rate),
    );
    c.f64(
        "rate_low",
        "1",
        "lower end of its 95 % interval by Wilson",
        rows().map(|t| t.interval()[0]),
    );
    c.f64(
        "rate_high",
        "1",
        "upper end of its 95 % interval by Wilson",
        rows().map(|t| t.interval()[1]),
    );
    for (outcome, name, about) in OTHERS {
        c.i64(name, about, rows().map(move |t| t.count(outcome)));
    }
    c
}

/// Returns one row per object and cell.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(trials: &[Trials]) -> Result<RecordBatch, SchemaError> {
    columns(trials).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version, or if the outcomes are not all trials.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Trials>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let row = |row: usize| {
        let mut outcomes_n = [0; Outcome::ALL.len()];
        for (n, outcome) in outcomes_n.iter_mut().zip(Outcome::ALL) {
            let other = OTHERS.iter().find(|(other, _, _)| *other == outcome);
            *n = r.i64(other.map_or("successes_n", |(_, name, _)| name), row)?;
        }
        let trials = Trials {
            object: r.utf8("object", row)?.to_owned(),
            cell: r.utf8("cell", row)?.to_owned(),
            simulated: r.bool("simulated", row)?,
            gap: r.utf8("gap", row)?.to_owned(),
            outcomes_n,
        };
        let trials_n = r.i64("trials_n", row)?;
        if trials.trials_n() == trials_n {
            return Ok(trials);
        }
        let ended_n = trials.trials_n();
        let message = format!("{trials_n} trials, and {ended_n} that ended in some way");
        Err(r.invalid("trials_n", message))
    };
    (0..r.rows()).map(row).collect()
}

/// The rows of one partition.
pub type AllTrials = Vec<Trials>;

impl Table for AllTrials {
    const NAME: &'static str = "trials";
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
