//! Outcomes of goals, as a cell publishes them.

use schemas::executions::Outcome;
use serde::{Deserialize, Serialize};

use crate::wire::{self, WireError};

/// The outcome of a goal.
///
/// A cell numbers its goals in the order of acceptance, which is also the order in which they end.
/// A watcher that misses a number queries `results?from=N`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GoalOutcome {
    /// Name of the journal that numbers the goals: a cell that has lost its goals begins another.
    pub journal: String,
    /// Number of the goal, from 0.
    pub result_n: u64,
    /// The goal's id.
    pub goal_id: String,
    /// The outcome.
    #[serde(with = "word")]
    pub outcome: Outcome,
    /// The cell's message.
    pub message: String,
    /// Rise of the object at the end, in meters.
    pub lift_m: f64,
}

/// First line of the answer to an outcomes query; one line per outcome follows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct OutcomesHeader {
    /// As in [`GoalOutcome`].
    pub(crate) journal: String,
    /// Number of goals that have ended.
    pub(crate) results_n: u64,
}

/// Outcomes, oldest first, and their total number.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outcomes {
    pub(crate) header: OutcomesHeader,
    pub(crate) outcomes: Vec<GoalOutcome>,
}

impl GoalOutcome {
    pub(crate) fn to_line(&self) -> Vec<u8> {
        wire::line(self)
    }

    /// Parses a published outcome.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not an outcome.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        Ok(wire::split_line("outcome", bytes)?.0)
    }
}

impl Outcomes {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = wire::line(&self.header);
        for outcome in &self.outcomes {
            bytes.extend(outcome.to_line());
        }
        bytes
    }

    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let (header, mut rest): (OutcomesHeader, _) = wire::split_line("outcomes", bytes)?;
        let mut outcomes = Vec::new();
        while !rest.is_empty() {
            let (outcome, after) = wire::split_line("outcome", rest)?;
            outcomes.push(outcome);
            rest = after;
        }
        Ok(Self { header, outcomes })
    }
}

/// Serializes an outcome as its word.
mod word {
    use schemas::executions::Outcome;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
    pub(super) fn serialize<S: Serializer>(
        outcome: &Outcome,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(outcome.as_str())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Outcome, D::Error> {
        let word = String::deserialize(deserializer)?;
        Outcome::parse(&word).ok_or_else(|| D::Error::custom(format!("`{word}` is not an outcome")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_arrive_as_they_were_and_damaged_ones_do_not() {
        let outcome = |result_n: u64| GoalOutcome {
            journal: "aa".to_owned(),
            result_n,
            goal_id: "00ff".to_owned(),
            outcome: Outcome::Aborted,
            message: "a\nb \"c\"".to_owned(),
            lift_m: 0.1 + 0.2,
        };
        let outcomes = Outcomes {
            header: OutcomesHeader {
                journal: "aa".to_owned(),
                results_n: 9,
            },
            outcomes: vec![outcome(7), outcome(8)],
        };
        let bytes = outcomes.to_bytes();
        assert_eq!(Outcomes::from_bytes(&bytes).unwrap(), outcomes);
        assert!(Outcomes::from_bytes(&bytes[..bytes.len() - 2]).is_err());
        let other = String::from_utf8(bytes)
            .unwrap()
            .replace("aborted", "happy");
        assert!(Outcomes::from_bytes(other.as_bytes()).is_err());
    }
}
