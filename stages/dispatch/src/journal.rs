//! Goals sent and their reports, for the run that resumes after this one was killed.
//!
//! In the folder that survives restarts, `<goal id>.sent` is written before a goal is sent, with
//! the journal of the receiving cell, and `<goal id>.report` when its report arrives. A goal with
//! only the first file may have moved the robot: the outcome is queried from that cell before
//! anything else is sent.

use std::{fs, io::ErrorKind, path::PathBuf};

use cell::{Goal, Report, UncheckedReport};
use lake::LakeError;
use robot::Joint;

use crate::DispatchError;

/// The journal of one unit.
pub(crate) struct Journal {
    folder: PathBuf,
}

/// State of a goal before this run.
#[derive(Debug, PartialEq)]
pub(crate) enum GoalHistory {
    /// Never sent.
    New,
    /// Sent to the cell with this journal, outcome not recorded.
    Sent(String),
    /// Ended with this report.
    Over(Box<Report>),
}

impl Journal {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Looks a goal up, for a robot with these joints. An unreadable or contradictory report is
    /// ignored: the cell has it.
    pub(crate) fn history(&self, goal: &Goal, robot: &[Joint]) -> GoalHistory {
        let goal_id = goal.encode().goal_id;
        let report = fs::read(self.file(&goal_id, "report")).ok();
        let report = report
            .and_then(|bytes| UncheckedReport::from_bytes(&bytes).ok())
            .and_then(|report| report.check(goal, robot).ok());
        if let Some(report) = report {
            return GoalHistory::Over(Box::new(report));
        }
        match fs::read_to_string(self.file(&goal_id, "sent")) {
            Ok(journal) => GoalHistory::Sent(journal),
            Err(err) if err.kind() == ErrorKind::NotFound => GoalHistory::New,
            // Of a note that cannot be read, only that the goal may have been sent is known.
            Err(_) => GoalHistory::Sent(String::new()),
        }
    }

    /// Records that a goal is about to be sent to the cell with this journal.
    pub(crate) fn send(&self, goal_id: &str, journal: &str) -> Result<(), DispatchError> {
        let file = self.file(goal_id, "sent");
        Ok(lake::write_atomic(&file, journal.as_bytes())?)
    }

    /// Records that a cell refused a goal: it may be sent to any other.
    pub(crate) fn withdraw(&self, goal_id: &str) -> Result<(), DispatchError> {
        let path = self.file(goal_id, "sent");
        fs::remove_file(&path).map_err(|source| {
            let action = "remove";
            DispatchError::Lake(LakeError::Io {
                action,
                path,
                source,
            })
        })
    }

    /// Records a goal's report.
    pub(crate) fn conclude(&self, report: &Report) -> Result<(), DispatchError> {
        let file = self.file(&report.goal_id, "report");
        Ok(lake::write_atomic(&file, &report.to_bytes())?)
    }

    /// Ids are hexadecimal digits.
    fn file(&self, goal_id: &str, ending: &str) -> PathBuf {
        self.folder.join(format!("{goal_id}.{ending}"))
    }
}
