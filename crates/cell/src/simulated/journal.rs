//! What a cell remembers of its goals, so that none is executed twice: not even by the cell that is
//! started again after this one was killed.
//!
//! In the journal's folder `<goal id>.goal` is the goal as it came, written before the cell answers
//! that it takes it, and `<goal id>.report` what came of it. A goal without a report was being
//! executed when the cell went down: nobody knows how far, so its report is `unknown`.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use zenoh::query::Query;

use crate::{
    CellError,
    goal::{Goal, Rejection, RejectionCode, SealedGoal},
    report::Report,
};

const GOAL: &str = "goal";
const REPORT: &str = "report";
/// Held for as long as a cell uses the folder.
const LOCK: &str = "lock";

/// A goal that was taken and waits for the robot.
pub(super) struct Job {
    pub(super) sealed: SealedGoal,
    pub(super) goal: Goal,
}

/// Every goal taken, by id. Ids follow from the content, so that one id is one content.
#[derive(Default)]
pub(super) struct Journal {
    entries: BTreeMap<String, Entry>,
    folder: Option<Folder>,
}

struct Folder {
    path: PathBuf,
    _lock: File,
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
    /// The motion is over; the report is in the folder.
    Stored,
}

impl Journal {
    /// Opens the journal in a folder, which is made where it is not there.
    pub(super) fn open(path: &Path) -> Result<Self, CellError> {
        let failed = |source: io::Error| CellError::Journal {
            path: path.to_owned(),
            source,
        };
        fs::create_dir_all(path).map_err(failed)?;
        let lock = File::create(path.join(LOCK)).map_err(failed)?;
        lock.try_lock().map_err(|err| failed(err.into()))?;
        let mut journal = Self {
            entries: BTreeMap::new(),
            folder: Some(Folder {
                path: path.to_owned(),
                _lock: lock,
            }),
        };
        for entry in fs::read_dir(path).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            let id = file.file_stem().and_then(|stem| stem.to_str());
            if file.extension().is_none_or(|ending| ending != GOAL) {
                continue;
            }
            let Some(id) = id else { continue };
            if !file.with_extension(REPORT).exists() {
                let message = "the cell went down during this motion; look at the robot";
                let report = Report::unknown(id, message.to_owned()).to_bytes();
                lake::write_whole(&file.with_extension(REPORT), &report)
                    .map_err(|err| failed(io::Error::other(err)))?;
            }
            journal.entries.insert(id.to_owned(), Entry::Stored);
        }
        Ok(journal)
    }

    /// Notes a goal; returns whether it is to be executed now (and not known already).
    pub(super) fn admit(&mut self, goal: &SealedGoal) -> Result<bool, Rejection> {
        if self.knows(&goal.goal_id) {
            return Ok(false);
        }
        if let Some(id) = self.executing() {
            return Err(Rejection::new(
                RejectionCode::Busy,
                format!("the cell executes goal {id}"),
            ));
        }
        if let Some(path) = self.file(&goal.goal_id, GOAL) {
            lake::write_whole(&path, &goal.bytes).map_err(|err| {
                Rejection::new(
                    RejectionCode::Storage,
                    format!("the cell cannot write down that it takes the goal: {err}"),
                )
            })?;
        }
        self.entries
            .insert(goal.goal_id.clone(), Entry::Executing(Vec::new()));
        Ok(true)
    }

    /// Returns whether the goal was taken before.
    pub(super) fn knows(&self, goal_id: &str) -> bool {
        self.entries.contains_key(goal_id)
    }

    /// Returns the goal that is being executed.
    pub(super) fn executing(&self) -> Option<&str> {
        let mut entries = self.entries.iter();
        let found = entries.find(|(_, entry)| matches!(entry, Entry::Executing(_)));
        found.map(|(id, _)| id.as_str())
    }

    /// Takes a question for a report: keeps it while the robot moves, else says what to answer.
    pub(super) fn ask(&mut self, goal_id: &str, query: Query) -> Asked {
        let file = self.file(goal_id, REPORT);
        match self.entries.get_mut(goal_id) {
            None => Asked::NeverTaken(query),
            Some(Entry::Executing(waiting)) => {
                waiting.push(query);
                Asked::Kept
            }
            Some(Entry::Done(report)) => Asked::Over(query, report.clone()),
            Some(Entry::Stored) => {
                let report = file.and_then(|file| fs::read(file).ok());
                let report = report.unwrap_or_else(|| {
                    let message = "the cell has lost its report on this motion";
                    Report::unknown(goal_id, message.to_owned()).to_bytes()
                });
                Asked::Over(query, report)
            }
        }
    }

    /// Notes a goal's report; returns who waits for it.
    pub(super) fn conclude(&mut self, goal_id: &str, report: Vec<u8>) -> Vec<Query> {
        // Where it cannot be written it is kept here: this cell can tell, and the one started after
        // it will say that it does not know.
        let path = self.file(goal_id, REPORT);
        let stored = path.is_some_and(|path| lake::write_whole(&path, &report).is_ok());
        let entry = if stored {
            Entry::Stored
        } else {
            Entry::Done(report)
        };
        match self.entries.insert(goal_id.to_owned(), entry) {
            Some(Entry::Executing(waiting)) => waiting,
            Some(Entry::Done(_) | Entry::Stored) | None => Vec::new(),
        }
    }

    /// Returns how many goals are over.
    pub(super) fn executed_n(&self) -> usize {
        let done = |entry: &&Entry| !matches!(entry, Entry::Executing(_));
        self.entries.values().filter(done).count()
    }

    /// Ids are hexadecimal digits: they follow from a digest that was checked.
    fn file(&self, goal_id: &str, ending: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        Some(folder.path.join(format!("{goal_id}.{ending}")))
    }
}

#[cfg(test)]
mod tests {
    use schemas::executions::Outcome;

    use super::*;

    fn sealed(id: &str) -> SealedGoal {
        SealedGoal {
            goal_id: id.to_owned(),
            digest: id.to_owned(),
            valid_until_unix_ms: None,
            bytes: b"goal".to_vec(),
        }
    }

    #[test]
    fn a_goal_taken_by_a_cell_that_went_down_is_known_and_its_end_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        assert!(journal.admit(&sealed("00")).unwrap());
        journal.conclude("00", Report::aborted("00", "broken".to_owned()).to_bytes());
        assert!(journal.admit(&sealed("01")).unwrap());
        drop(journal);
        let mut journal = Journal::open(folder.path()).unwrap();
        for id in ["00", "01"] {
            assert!(!journal.admit(&sealed(id)).unwrap());
        }
        let report = |id: &str| {
            let bytes = fs::read(folder.path().join(format!("{id}.report"))).unwrap();
            Report::from_bytes(&bytes).unwrap().outcome
        };
        assert_eq!(
            [report("00"), report("01")],
            [Outcome::Aborted, Outcome::Unknown]
        );
        assert_eq!(journal.executed_n(), 2);
    }

    #[test]
    fn one_folder_serves_one_cell_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::open(folder.path()).unwrap();
        assert!(Journal::open(folder.path()).is_err());
        drop(journal);
        assert!(Journal::open(folder.path()).is_ok());
    }

    #[test]
    fn what_cannot_be_written_down_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        // A folder stands where the goal's file would.
        fs::create_dir(folder.path().join("00.goal")).unwrap();
        fs::write(folder.path().join("00.goal/file"), b"").unwrap();
        let refused = journal.admit(&sealed("00")).unwrap_err();
        assert_eq!(refused.code, RejectionCode::Storage);
        assert!(!journal.knows("00"));
    }
}
