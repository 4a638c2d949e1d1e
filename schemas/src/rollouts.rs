//! `rollouts`: the outcome of each candidate in simulation, one partition per object, one row per
//! candidate.

use crate::{
    candidates::{Candidate, DrawSource},
    columns::{columns, words},
    table::table,
};

columns! {
    /// What a simulation measures of one motion, verdict aside; what it did not measure is none. The default is that of a
    /// motion that was not simulated.
    #[derive(Debug, Clone, Copy, Default, PartialEq)]
    pub struct Measures {
        control_steps_n: u32 => "control steps simulated; with `skipped_steps_n` those of the full script",
        skipped_steps_n: Option<u32>
            => "control steps of the script that were not simulated; null if there is no script, as of an `infeasible` motion",
        lift_m: Option<f64> ["m"] => "rise of the object's origin at the end; null if nothing was simulated",
        slip_m: Option<f64> ["m"]
            => "motion of the object in the palm frame between lift and end; null if the motion ended before",
        displacement_m: Option<f64> ["m"]
            => "motion of the object on the table before the squeeze; null if nothing was simulated until then",
        penetration_m: Option<f64> ["m"]
            => "deepest that the hand was in the object while it was held; null if the motion ended before",
        finger_penetration_m: Option<f64> ["m"]
            => "deepest that links of different fingers, or a finger and the palm, were in each other at the start of any physics step; null unless they touch both",
        contacts_n: Option<u32>
            => "hand links in contact with the object at the end; null if the motion ended before the end of the hold",
    }
}

columns! {
    /// The outcome of one candidate in simulation.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Rollout {
        candidate_id: String => "the motion",
        generator: String => "what drew it",
        /// Source of the candidate.
        source: DrawSource,
        protocol: Option<String> => "protocol by which the motion was judged, e.g. `full_contact`; null if unknown",
        + success: bool = |rollout| rollout.verdict == Verdict::Held
            => "lifted, held to the end and still in contact",
        verdict as reason: Verdict => "`held`, or why it failed",
        /// What the simulation measured.
        measures: Measures,
    }
}

impl Rollout {
    /// Returns the row of a candidate of which nothing was simulated.
    pub fn unsimulated(candidate: &Candidate, verdict: Verdict) -> Self {
        Self {
            candidate_id: candidate.candidate_id.clone(),
            generator: candidate.generator.clone(),
            source: candidate.source.clone(),
            protocol: None,
            verdict,
            measures: Measures::default(),
        }
    }
}

/// The rollouts of one object's candidates.
pub type Rollouts = Vec<Rollout>;
table! {"rollouts", 8, per "object", rows: Rollout}

words! {
    /// Outcome of a rollout; success is first.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Verdict: "verdict" {
        /// Lifted and held to the end.
        Held = "held",
        /// A commanded joint position violates its limits.
        Limit = "limit",
        /// The motion would pass through the table.
        Table = "table",
        /// The motion would pass through the object before the grasp.
        EarlyContact = "early_contact",
        /// The object was pushed away or over before the squeeze.
        KnockedOver = "knocked_over",
        /// Nothing was lifted.
        NotGrasped = "not_grasped",
        /// The object moved in the hand while it was held.
        Slipped = "slipped",
        /// Lifted, and fell before the end.
        Dropped = "dropped",
        /// Held to the end, with the hand deeper in the object or in itself than solid bodies can be.
        TooDeep = "too_deep",
        /// Object and table loaded the palm more than an arm bears.
        Overloaded = "overloaded",
        /// The simulation became non-finite or implausible.
        Diverged = "diverged",
        /// The hand cannot execute the motion, or the object does not come to rest as it lies in it;
        /// nothing was simulated.
        Infeasible = "infeasible",
    }
}
