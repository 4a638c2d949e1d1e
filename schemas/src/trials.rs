//! `trials`: success rates of the motions executed by a robot cell, one partition for all objects,
//! one row per object and cell: the paper's table of real-world results, for any cell.

use crate::{
    SchemaError,
    columns::{Flatten, columns},
    executions::Outcome,
    success::wilson,
    table::table,
};

/// The outcomes of the motions for one object at one cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Trials {
    /// The object's name.
    pub object: String,
    /// The cell's name.
    pub cell: String,
    /// Whether the cell reports that it is simulated.
    pub simulated: bool,
    /// How the cell differs from the planned one, as it reports.
    pub gap: String,
    /// Number of motions per outcome, in the order of [`Outcome::ALL`].
    pub outcomes_n: [i64; Outcome::ALL.len()],
}

impl Trials {
    /// Returns the number of motions with this outcome.
    pub fn count(&self, outcome: Outcome) -> i64 {
        let mut counts = Outcome::ALL.iter().zip(self.outcomes_n);
        let found = counts.find(|(known, _)| **known == outcome);
        found.map_or(0, |(_, n)| n)
    }

    /// Returns the number of motions that may have moved anything and were not canceled by a
    /// person.
    pub fn trials_n(&self) -> i64 {
        let others = [Outcome::Rejected, Outcome::Stopped].map(|outcome| self.count(outcome));
        self.outcomes_n.iter().sum::<i64>() - others.iter().sum::<i64>()
    }

    /// Returns the number of successes.
    pub fn successes_n(&self) -> i64 {
        self.count(Outcome::Succeeded)
    }

    /// Returns the share of the trials that succeeded, in 0..=1; 0 if there are none.
    pub fn rate(&self) -> f64 {
        self.successes_n() as f64 / self.trials_n().max(1) as f64
    }

    /// Returns the 95 % interval of that share.
    pub fn interval(&self) -> [f64; 2] {
        wilson(self.successes_n() as f64, self.trials_n() as f64)
    }
}

/// The trials of all objects.
pub type AllTrials = Vec<Trials>;
table! {"trials", 2, rows: Trials}

columns! {
    /// The columns of [`Trials`].
    pub(crate) struct Flat {
        object: String => "the object",
        cell: String => "the cell's name",
        simulated: bool => "whether the cell says that nothing real moves",
        gap: String => "how it differs from what was planned for, as it says",
        trials_n: i64
            => "motions of which anything may have moved, but for those that a person stopped",
        successes_n: i64 => "those that lifted and held the object",
        rate: f64 ["1"] => "share of the trials that succeeded; 0 of none",
        rate_low: f64 ["1"] => "lower end of its 95 % interval by Wilson",
        rate_high: f64 ["1"] => "upper end of its 95 % interval by Wilson",
        failed_n: i64 => "trials that ended without the object held",
        aborted_n: i64 => "trials that the cell broke off",
        unknown_n: i64 => "trials of which nobody knows the end",
        rejected_n: i64 => "motions that were not sent or not taken: no trials",
        stopped_n: i64 => "motions that a person stopped: no trials",
    }
}

impl Flatten for Trials {
    type Flat = Flat;

    fn flat(&self) -> Flat {
        let [rate_low, rate_high] = self.interval();
        Flat {
            object: self.object.clone(),
            cell: self.cell.clone(),
            simulated: self.simulated,
            gap: self.gap.clone(),
            trials_n: self.trials_n(),
            successes_n: self.successes_n(),
            rate: self.rate(),
            rate_low,
            rate_high,
            failed_n: self.count(Outcome::Failed),
            aborted_n: self.count(Outcome::Aborted),
            unknown_n: self.count(Outcome::Unknown),
            rejected_n: self.count(Outcome::Rejected),
            stopped_n: self.count(Outcome::Stopped),
        }
    }

    fn from_flat(flat: Flat) -> Result<Self, SchemaError> {
        let trials = Self {
            object: flat.object,
            cell: flat.cell,
            simulated: flat.simulated,
            gap: flat.gap,
            outcomes_n: Outcome::ALL.map(|outcome| match outcome {
                Outcome::Succeeded => flat.successes_n,
                Outcome::Failed => flat.failed_n,
                Outcome::Rejected => flat.rejected_n,
                Outcome::Aborted => flat.aborted_n,
                Outcome::Stopped => flat.stopped_n,
                Outcome::Unknown => flat.unknown_n,
            }),
        };
        match (flat.trials_n, trials.trials_n()) {
            (trials_n, ended_n) if trials_n == ended_n => Ok(trials),
            (trials_n, ended_n) => Err(SchemaError::invalid(
                "trials_n",
                format!("{trials_n} trials, and {ended_n} that ended in some way"),
            )),
        }
    }
}
