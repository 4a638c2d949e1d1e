//! `success`: success rates of the candidates of each object, one partition for all objects, one
//! row per object, generator and origin of the motions.
//!
//! A draw counts for the origin of its own code, also where another draw of the motion was kept.
//! Candidates of one object are drawn independently: the interval of `rate` is Wilson's; `draw_rate`
//! has none, and the rates over objects have their own (`rates`).
//!
//! A grasp is the last step of a candidate, the palm in the object's frame. Spread is the root mean
//! square over successful grasps of the distance from their mean: for the palm's origin √(Σ|p −
//! p̄|²/n), for its orientation √(Σ∠(R, R̄)²/n) with R̄ the rotation of least squared distance as
//! matrices (Markley et al., *Averaging Quaternions*, 2007), for dof joints √(Σ|q − q̄|²/(n ·
//! dof)). Only grasps of an object that lies alike, its up directions within 10 degrees, share a mean, and one
//! without others is left out: `spread_n` is n, and with 0 of them every spread is null.

use crate::{
    candidates::{ObjectSplit, Origin},
    columns::columns,
    rollouts::Verdict,
    table::table,
    tally::{OutcomeClass, Tally, share},
};

columns! {
    /// The success rate of one generator's candidates of one origin for one object.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Success {
        object: String => "the object",
        generator: String => "what drew the candidates",
        origin: Origin => "where the motions come from, as in `candidates`",
        object_split: Option<ObjectSplit> => "split of the object, as in `candidates`",
        /// The candidates by verdict.
        verdicts: Tally<Verdict>,
        draws_n: i64 => "draws of this origin, refused ones included",
        + draw_rate: Option<f64> ["1"] = |row| share(row.verdicts.success_count(), row.draws_n)
            => "share of the draws that held; null of none",
        control_steps_n: i64 => "control steps simulated, for failures too",
        + control_steps_per_success: Option<f64> ["1"] = Self::control_steps_per_success
            => "control steps simulated, for failures too, per success; null without one",
        spread_palm_m: Option<f64> ["m"]
            => "root mean square distance of the palms of successful grasps from their mean; null if `spread_n` is 0",
        spread_palm_rad: Option<f64> ["rad"]
            => "root mean square angle of the palms of successful grasps from their mean; null if `spread_n` is 0",
        spread_q_rad: Option<f64> ["rad"]
            => "root mean square difference of the joint positions of successful grasps from their mean; null if `spread_n` is 0",
        spread_n: i64 => "successful grasps that have another one to be compared with",
    }
}

impl Success {
    /// Returns the control steps simulated for each success, failures included; none without a success.
    pub fn control_steps_per_success(&self) -> Option<f64> {
        match self.verdicts.success_count() {
            0 => None,
            n => Some(self.control_steps_n as f64 / n as f64),
        }
    }
}

impl OutcomeClass for Verdict {
    const ALL: &'static [Self] = &Self::ALL;
    const TOTAL: [&'static str; 2] = ["candidates_n", "candidates that were screened"];
    const RATE: &'static str = "share of the candidates that held; null of none";

    fn word(self) -> &'static str {
        self.as_str()
    }

    fn about(self) -> String {
        match self {
            Self::Held => "those that were lifted and held to the end".to_owned(),
            failed => format!("those that failed by `{}`", failed.as_str()),
        }
    }
}

/// The success of the candidates of all objects.
pub type Successes = Vec<Success>;
table! {"success", 6, per "screening", rows: Success}
