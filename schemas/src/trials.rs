//! `trials`: success rates of the motions executed by a robot cell, one partition for all objects,
//! one row per object and cell: the paper's table of real-world results, for any cell.

use crate::{
    columns::columns,
    executions::Outcome,
    table::table,
    tally::{OutcomeClass, Tally},
};

columns! {
    /// The outcomes of the motions for one object at one cell.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Trials {
        object: String => "the object",
        cell: String => "the cell's name",
        simulated: bool => "whether the cell says that nothing real moves",
        gap: String => "how it differs from what was planned for, as it says",
        /// The motions by outcome.
        outcomes: Tally<Outcome>,
    }
}

/// A trial is a motion that may have moved anything and was not canceled by a person.
impl OutcomeClass for Outcome {
    const ALL: &'static [Self] = &Self::ALL;
    const TOTAL: [&'static str; 2] = [
        "trials_n",
        "motions of which anything may have moved, but for those that a person stopped",
    ];
    const RATE: &'static str = "share of the trials that succeeded; null of none";

    fn word(self) -> &'static str {
        self.as_str()
    }

    fn about(self) -> String {
        let about = match self {
            Self::Succeeded => "those that lifted and held the object",
            Self::Failed => "trials that ended without the object held",
            Self::Aborted => "trials that the cell broke off",
            Self::Unknown => "trials of which nobody knows the end",
            Self::Rejected => "motions that were not sent or not taken: no trials",
            Self::Stopped => "motions that a person stopped: no trials",
        };
        about.to_owned()
    }

    fn is_trial(self) -> bool {
        !matches!(self, Self::Rejected | Self::Stopped)
    }
}

/// The trials of all objects.
pub type AllTrials = Vec<Trials>;
table! {"trials", 3, per "dispatching", rows: Trials}
