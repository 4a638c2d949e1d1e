//! What was sent and what came of it, for the run that goes on after this one was killed.
//!
//! In the folder that outlives an attempt, `<goal id>.sent` is written before a goal goes out, with the
//! journal of the cell to which it goes, and `<goal id>.report` when its report is there. A goal of which
//! only the first exists may have moved the robot: that cell is asked what it knows of it, before anything
//! else is sent.

use std::{fs, io::ErrorKind, path::PathBuf};

use cell::{Goal, Report, UncheckedReport};
use lake::LakeError;
use robot::Joint;

use crate::DispatchError;

/// The journal of one unit.
pub(crate) struct Journal {
    folder: PathBuf,
}

/// What is known of a goal from before.
#[derive(Debug, PartialEq)]
pub(crate) enum Past {
    /// It was never sent.
    New,
    /// It was sent to the cell with this journal, and nobody waited for the end.
    Sent(String),
    /// What came of it.
    Over(Box<Report>),
}

impl Journal {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Looks a goal up, for a robot with these joints. A report that cannot be read or believed counts as
    /// none: the cell has it.
    pub(crate) fn past(&self, goal: &Goal, robot: &[Joint]) -> Past {
        let goal_id = goal.seal().goal_id;
        let report = fs::read(self.file(&goal_id, "report")).ok();
        let report = report
            .and_then(|bytes| UncheckedReport::from_bytes(&bytes).ok())
            .and_then(|report| report.check(goal, robot).ok());
        if let Some(report) = report {
            return Past::Over(Box::new(report));
        }
        match fs::read_to_string(self.file(&goal_id, "sent")) {
            Ok(journal) => Past::Sent(journal),
            Err(err) if err.kind() == ErrorKind::NotFound => Past::New,
            // Of a note that cannot be read, only that the goal may have been sent is known.
            Err(_) => Past::Sent(String::new()),
        }
    }

    /// Notes that a goal is about to be sent to the cell with this journal.
    pub(crate) fn send(&self, goal_id: &str, journal: &str) -> Result<(), DispatchError> {
        let file = self.file(goal_id, "sent");
        Ok(lake::write_whole(&file, journal.as_bytes())?)
    }

    /// Notes that a cell did not take a goal: it may go to any other.
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

    /// Notes what came of a goal.
    pub(crate) fn conclude(&self, report: &Report) -> Result<(), DispatchError> {
        let file = self.file(&report.goal_id, "report");
        Ok(lake::write_whole(&file, &report.to_bytes())?)
    }

    /// Ids are hexadecimal digits.
    fn file(&self, goal_id: &str, ending: &str) -> PathBuf {
        self.folder.join(format!("{goal_id}.{ending}"))
    }
}
