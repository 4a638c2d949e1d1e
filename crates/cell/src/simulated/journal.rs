//! What a cell remembers of its goals, so that none is executed twice.

use std::collections::BTreeMap;

use zenoh::query::Query;

use crate::goal::{Goal, Rejection, RejectionCode, SealedGoal};

/// A goal that was taken and waits for the robot.
pub(super) struct Job {
    pub(super) sealed: SealedGoal,
    pub(super) goal: Goal,
}

/// Every goal taken, by id. Ids follow from the content, so that one id is one content.
#[derive(Default)]
pub(super) struct Journal {
    entries: BTreeMap<String, Entry>,
}

/// What to do about a question for a report.
pub(super) enum Asked {
    /// Nothing yet: it is answered when the motion is over.
    Kept,
    /// Answer with this report.
    Over(Query, Vec<u8>),
    /// Answer that no such goal was taken.
    NeverTaken(Query),
}

enum Entry {
    /// The robot moves; these want to know the end.
    Executing(Vec<Query>),
    /// The motion is over; this is the report.
    Done(Vec<u8>),
}

impl Journal {
    /// Notes a goal; returns whether it is to be executed now (and not known already).
    pub(super) fn admit(&mut self, goal: &SealedGoal) -> Result<bool, Rejection> {
        if self.entries.contains_key(&goal.goal_id) {
            return Ok(false);
        }
        let busy = self
            .entries
            .iter()
            .find(|(_, entry)| matches!(entry, Entry::Executing(_)));
        if let Some((id, _)) = busy {
            return Err(Rejection::new(
                RejectionCode::Busy,
                format!("the cell executes goal {id}"),
            ));
        }
        self.entries
            .insert(goal.goal_id.clone(), Entry::Executing(Vec::new()));
        Ok(true)
    }

    /// Takes a question for a report: keeps it while the robot moves, else says what to answer.
    pub(super) fn ask(&mut self, goal_id: &str, query: Query) -> Asked {
        match self.entries.get_mut(goal_id) {
            None => Asked::NeverTaken(query),
            Some(Entry::Executing(waiting)) => {
                waiting.push(query);
                Asked::Kept
            }
            Some(Entry::Done(report)) => Asked::Over(query, report.clone()),
        }
    }

    /// Notes a goal's report; returns who waits for it.
    pub(super) fn conclude(&mut self, goal_id: &str, report: Vec<u8>) -> Vec<Query> {
        match self.entries.insert(goal_id.to_owned(), Entry::Done(report)) {
            Some(Entry::Executing(waiting)) => waiting,
            Some(Entry::Done(_)) | None => Vec::new(),
        }
    }

    /// Returns how many goals are over.
    pub(super) fn executed_n(&self) -> usize {
        let done = |entry: &&Entry| matches!(entry, Entry::Done(_));
        self.entries.values().filter(done).count()
    }
}
