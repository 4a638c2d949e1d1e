//! Choice of the recorded rollouts on a page.

use std::collections::BTreeSet;

use schemas::rollouts::{Rollout, Verdict};

/// Class of a motion by its outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OutcomeGroup {
    /// It held.
    Success,
    /// It failed after the object was lifted or held, or for depth alone.
    NearMiss,
    /// It failed before.
    Failure,
}

impl OutcomeGroup {
    /// Returns the outcome group of a rollout.
    pub fn of(rollout: &Rollout) -> Self {
        match rollout.verdict {
            Verdict::Held => Self::Success,
            Verdict::Slipped | Verdict::Dropped | Verdict::TooDeep | Verdict::Overloaded => {
                Self::NearMiss
            }
            Verdict::Limit
            | Verdict::Table
            | Verdict::EarlyContact
            | Verdict::KnockedOver
            | Verdict::NotGrasped
            | Verdict::Diverged
            | Verdict::Infeasible => Self::Failure,
        }
    }

    /// Returns its word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Success => "success",
            Self::NearMiss => "near miss",
            Self::Failure => "failure",
        }
    }
}

/// A motion on the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The rollout's name.
    pub id: String,
    /// Its object.
    pub object: String,
    /// Its generator.
    pub generator: String,
    /// Origin of its latent code or motion.
    pub origin: String,
    /// The verdict's word.
    pub verdict: String,
    /// Its class.
    pub outcome: OutcomeGroup,
    /// Rise of the object at the end, in meters.
    pub lift_m: f64,
    /// Slip in the hand, in meters.
    pub slip_m: f64,
    /// Length, in seconds.
    pub duration_s: f64,
    /// Its recording, relative to the page.
    pub recording: Option<String>,
    /// The binary glTF file.
    pub glb: Vec<u8>,
}

/// A rollout with a recording.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded<'a> {
    pub(crate) object: &'a str,
    pub(crate) rollout: &'a Rollout,
}

/// Returns the places of at most `n` of the recorded rollouts, in the order in which a page lists them: one
/// of each reason for failing, a success of each object, near misses, other successes, other failures.
pub(crate) fn chosen(all: &[Recorded<'_>], n: usize) -> Vec<usize> {
    let mut picked: Vec<usize> = Vec::new();
    let mut reasons: BTreeSet<&str> = BTreeSet::new();
    let mut objects: BTreeSet<&str> = BTreeSet::new();
    let outcome = |idx: usize| all.get(idx).map(|one| OutcomeGroup::of(one.rollout));
    let of = |wanted: OutcomeGroup| (0..all.len()).filter(move |&idx| outcome(idx) == Some(wanted));
    for (idx, one) in all.iter().enumerate() {
        let is_new = reasons.insert(one.rollout.verdict.as_str());
        if one.rollout.verdict != Verdict::Held && is_new {
            picked.push(idx);
        }
    }
    for idx in of(OutcomeGroup::Success) {
        if all.get(idx).is_some_and(|one| objects.insert(one.object)) {
            picked.push(idx);
        }
    }
    let rest = of(OutcomeGroup::NearMiss)
        .chain(of(OutcomeGroup::Success))
        .chain(of(OutcomeGroup::Failure));
    for idx in rest {
        if !picked.contains(&idx) {
            picked.push(idx);
        }
    }
    picked.truncate(n);
    picked
}

#[cfg(test)]
mod tests {
    use schemas::{
        candidates::DrawSource,
        rollouts::{ExecutedSmoothness, Measures, Smoothness},
    };

    use super::*;

    fn rollout(verdict: Verdict) -> Rollout {
        Rollout {
            candidate_id: String::new(),
            generator: "cgf".to_owned(),
            source: DrawSource::replayed("a"),
            verdict,
            measures: Measures {
                control_steps_n: 1,
                ..Measures::default()
            },
            smoothness: Smoothness::default(),
            executed: ExecutedSmoothness(None),
        }
    }

    #[test]
    fn each_reason_and_each_object_comes_first_and_near_misses_before_more_successes() {
        use Verdict::{Dropped, Held, NotGrasped, Slipped};
        let rows = [
            ("can", Held),
            ("can", Held),
            ("can", NotGrasped),
            ("box", Slipped),
            ("box", Slipped),
            ("box", NotGrasped),
            ("cup", Held),
            ("cup", Dropped),
        ]
        .map(|(object, verdict)| (object, rollout(verdict)));
        let recorded: Vec<Recorded> = rows
            .iter()
            .map(|(object, rollout)| Recorded { object, rollout })
            .collect();
        assert_eq!(chosen(&recorded, 99), [2, 3, 7, 0, 6, 4, 1, 5]);
        assert_eq!(chosen(&recorded, 3), [2, 3, 7]);
        assert!(chosen(&[], 3).is_empty());
    }
}
