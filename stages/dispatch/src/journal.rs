//! What was sent and what came of it, for the run that goes on after this one was killed.
//!
//! In the folder that outlives an attempt, `<goal id>.sent` is written before a goal goes out and
//! `<goal id>.report` when its report is there. A goal of which only the first exists may have moved
//! the robot: the cell is asked what it knows of it, before anything else is sent.

use std::{fs, path::PathBuf};

use cell::Report;

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
    /// It was sent, and nobody waited for the end.
    Sent,
    /// What came of it.
    Over(Box<Report>),
}

impl Journal {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Looks a goal up. A report that cannot be read counts as none: the cell has it.
    pub(crate) fn past(&self, goal_id: &str) -> Past {
        let report = fs::read(self.file(goal_id, "report")).ok();
        match report.and_then(|bytes| Report::from_bytes(&bytes).ok()) {
            Some(report) => Past::Over(Box::new(report)),
            None if self.file(goal_id, "sent").exists() => Past::Sent,
            None => Past::New,
        }
    }

    /// Notes that a goal is about to be sent.
    pub(crate) fn send(&self, goal_id: &str) -> Result<(), DispatchError> {
        Ok(lake::write_whole(&self.file(goal_id, "sent"), b"")?)
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
