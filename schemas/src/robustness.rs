//! `robustness`: how often accepted motions succeed under drawn errors, one partition per object, one row per
//! motion that was tried again.
//!
//! All motions of an object are tried under the same drawn errors of its pose, of friction, of its mass and
//! of the fingers' delay, so that their shares can be compared. The interval is Wilson's.

use crate::{
    columns::columns,
    rollouts::Verdict,
    table::table,
    tally::{OutcomeClass, Tally},
};

columns! {
    /// The trials of one accepted motion under drawn errors.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Robustness {
        candidate_id: String => "the motion",
        /// The trials by verdict.
        trials: Tally<TrialVerdict>,
        control_steps_n: i64 => "control steps simulated in all trials",
    }
}

/// The verdict of a trial under drawn errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrialVerdict(pub Verdict);

impl OutcomeClass for TrialVerdict {
    const ALL: &'static [Self] = &{
        let mut all = [Self(Verdict::Held); Verdict::ALL.len()];
        let mut idx = 0;
        while idx < all.len() {
            all[idx] = Self(Verdict::ALL[idx]);
            idx += 1;
        }
        all
    };
    const TOTAL: [&'static str; 2] = ["trials_n", "trials under drawn errors"];
    const RATE: &'static str = "share of the trials that held; null of none";

    fn word(self) -> &'static str {
        self.0.as_str()
    }

    fn about(self) -> String {
        match self.0 {
            Verdict::Held => "those in which the object was lifted and held to the end".to_owned(),
            failed => format!("those that failed by `{}`", failed.as_str()),
        }
    }
}

/// The robustness of the motions of one object.
pub type RobustnessTable = Vec<Robustness>;
table! {"robustness", 3, per "object", rows: Robustness}
