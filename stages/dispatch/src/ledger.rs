//! What was ever sent to a cell: kept by cell and goal, apart from options, units and runs.
//!
//! In the stage's folder of effects:
//!
//! ```text
//! key, key.pub               the key that signs this lake's goals, and its public part
//! taken_over                 says that the goals of version 4 were taken over
//! earlier/ID.earlier         a goal that version 4 recorded without its cell
//! cells/NAME/lock            held by the unit that sends goals to the cell
//! cells/NAME/ID.goal         a line with what the cell said of itself and until when any message is valid, then
//!                            the message as last sent
//! cells/NAME/ID.accepted     the cell's signed acceptance, with the query that it answers
//! cells/NAME/ID.refused      the cell's refusal: nothing moved
//! cells/NAME/ID.report       the report that was believed
//! cells/NAME/ID.told         a run has ended because the outcome was unknown
//! cells/NAME/ID.earlier      a goal that version 4 recorded at this cell
//! ```
//!
//! A goal's file is written before the goal is sent. From then on its id is free again only if the
//! cell refused its only transmission, or never took it before it expired. Until then it may be sent again to
//! the journal that it was sent to alone, and only if that says it never took it and has not accepted it.

use std::{
    collections::BTreeSet,
    fs::{self, File, TryLockError},
    io::{self, ErrorKind},
    path::{Path, PathBuf},
};

use cell::{
    Acceptance, Capabilities, Goal, GoalMessage, RecordError, Rejection, Report, SendRecord,
    SigningKey,
};
use dataflow::BoxedDiagnostic;
use lake::LakeError;
use serde::{Deserialize, Serialize};

use crate::protocol_4::{EarlierGoal, take_over};

/// Folder of the cells' ledgers.
const CELLS: &str = "cells";
/// File with the public key of the lake's dispatcher.
const PUBLIC_KEY: &str = "key.pub";
/// Lock of a cell's ledger.
const LOCK: &str = "lock";
/// Endings of a goal's files.
const GOAL: &str = "goal";
const ACCEPTED: &str = "accepted";
const REFUSED: &str = "refused";
const REPORT: &str = "report";
const TOLD: &str = "told";
const EARLIER: &str = "earlier";

/// The ledger of one cell; without a folder nothing is remembered, for a cell that ends with this process.
pub(crate) struct Ledger {
    folders: Option<Folders>,
}

struct Folders {
    /// What was sent to the cell.
    cell: PathBuf,
    /// What version 4 recorded without a cell.
    earlier: PathBuf,
    /// Held while goals are sent.
    _lock: File,
}

/// A goal's state before this run.
#[derive(Debug)]
pub(crate) enum GoalHistory {
    /// Never sent, or nothing moved: it may be sent.
    Free,
    /// Sent, and its end is not known.
    Open(Box<OpenGoal>),
    /// Ended with this report.
    Ended {
        report: Box<Report>,
        /// What the cell said of itself.
        cell: CellFacts,
    },
}

/// A goal that was sent and whose end is not known.
#[derive(Debug, Clone, Default)]
pub(crate) struct OpenGoal {
    pub(crate) goal_id: String,
    /// The goal itself, if it can be read.
    pub(crate) goal: Option<Goal>,
    /// The journal that it was sent to; unknown if the record cannot be read.
    pub(crate) journal: Option<String>,
    /// Whether the cell has accepted it, or may have: then its id is never free again.
    pub(crate) accepted: bool,
    /// Until when it may start, by the dispatcher's clock, in milliseconds since 1970.
    pub(crate) valid_until_unix_ms: u64,
    /// Whether a run has ended because the outcome is unknown.
    pub(crate) told: bool,
    /// What the cell said of itself.
    pub(crate) cell: CellFacts,
    /// What version 4 recorded, for people.
    pub(crate) earlier: Option<String>,
}

/// First line of a goal's file.
#[derive(Serialize, Deserialize)]
struct GoalLine {
    #[serde(flatten)]
    cell: CellFacts,
    /// The latest time until which any message of the goal is valid, in milliseconds since 1970.
    valid_until_unix_ms: u64,
}

/// What a cell said of itself when a goal was sent.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct CellFacts {
    pub(crate) simulated: bool,
    pub(crate) gap: String,
}

impl CellFacts {
    pub(crate) fn of(cell: &Capabilities) -> Self {
        Self {
            simulated: cell.simulated,
            gap: cell.gap.clone(),
        }
    }
}

/// Returns the key that signs this lake's goals, and leaves its public part in a file for cells.
pub(crate) fn signing_key(effects: &Path) -> Result<SigningKey, BoxedDiagnostic> {
    let key = SigningKey::open(effects);
    let key = key.map_err(|source| failed("read or write the key in", effects, source))?;
    let (public, line) = (effects.join(PUBLIC_KEY), format!("{}\n", key.name()));
    if read(&public)?.is_none_or(|found| found != line.as_bytes()) {
        lake::write_atomic(&public, line.as_bytes())?;
    }
    Ok(key)
}

impl Ledger {
    /// Returns the ledger of a cell that ends with this process, and all that it did.
    pub(crate) fn none() -> Self {
        Self { folders: None }
    }

    /// Opens the ledger of a cell in the stage's folder of effects; waits, and says so once, while another
    /// unit sends to this cell.
    pub(crate) fn open(
        effects: &Path,
        cell: &str,
        waiting: impl FnOnce(),
    ) -> Result<Self, BoxedDiagnostic> {
        let folder = effects.join(CELLS).join(cell);
        fs::create_dir_all(&folder).map_err(|source| failed("create", &folder, source))?;
        let path = folder.join(LOCK);
        let lock = File::create(&path).map_err(|source| failed("create", &path, source))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                waiting();
                lock.lock()
                    .map_err(|source| failed("lock", &path, source))?;
            }
            Err(TryLockError::Error(source)) => return Err(failed("lock", &path, source).into()),
        }
        let earlier = effects.join(EARLIER);
        take_over(effects, |goal: &EarlierGoal| {
            let of_cell = |cell| effects.join(CELLS).join(cell);
            let folder = goal.cell.as_ref().map_or(earlier.clone(), of_cell);
            let line = serde_json::to_vec(goal).unwrap_or_default();
            let path = folder.join(format!("{}.{EARLIER}", goal.goal_id));
            lake::write_atomic(&path, &line)
        })?;
        Ok(Self {
            folders: Some(Folders {
                cell: folder,
                earlier,
                _lock: lock,
            }),
        })
    }

    /// Looks a goal up.
    pub(crate) fn history(&self, goal_id: &str) -> Result<GoalHistory, BoxedDiagnostic> {
        let Some(report) = self.read(goal_id, REPORT)? else {
            // An accepted goal is never free, whatever else is left of it.
            let is_refused = self.has(goal_id, REFUSED)? && !self.has(goal_id, ACCEPTED)?;
            let is_earlier = self.read_earlier(goal_id)?.is_some();
            let was_sent = is_earlier || self.has(goal_id, GOAL)?;
            return Ok(if was_sent && !is_refused {
                GoalHistory::Open(Box::new(self.open_goal(goal_id)?))
            } else {
                GoalHistory::Free
            });
        };
        let open = self.open_goal(goal_id)?;
        // The cell may still have a report that cannot be read here any more.
        Ok(match Report::from_record(&report) {
            Ok(report) => GoalHistory::Ended {
                report: Box::new(report),
                cell: open.cell,
            },
            Err(_) => GoalHistory::Open(Box::new(OpenGoal {
                accepted: true,
                ..open
            })),
        })
    }

    /// Returns the goals that this version sent and whose end is not known, in the order of their ids.
    pub(crate) fn open_goals(&self) -> Result<Vec<OpenGoal>, BoxedDiagnostic> {
        let Some(Folders { cell: folder, .. }) = &self.folders else {
            return Ok(Vec::new());
        };
        let entries = fs::read_dir(folder).map_err(|source| failed("read", folder, source))?;
        let (mut ids, mut ended) = (BTreeSet::new(), BTreeSet::new());
        for entry in entries {
            let path = entry
                .map_err(|source| failed("read", folder, source))?
                .path();
            let id = path.file_stem().and_then(|stem| stem.to_str());
            let ending = path.extension().and_then(|ending| ending.to_str());
            match (id, ending) {
                (Some(id), Some(GOAL)) => drop(ids.insert(id.to_owned())),
                (Some(id), Some(REPORT)) => drop(ended.insert(id.to_owned())),
                _ => {}
            }
        }
        let mut open = Vec::new();
        for id in ids.difference(&ended) {
            if let GoalHistory::Open(goal) = self.history(id)? {
                open.push(*goal);
            }
        }
        Ok(open)
    }

    /// Records that a cell never took a goal before it expired: it may be sent again, to any journal.
    pub(crate) fn free(&self, goal_id: &str) -> Result<(), LakeError> {
        self.write(goal_id, REFUSED, b"expired")
    }

    /// Records the report on a goal.
    pub(crate) fn conclude(&self, report: &Report) -> Result<(), LakeError> {
        self.write(&report.goal_id, REPORT, &report.to_bytes())
    }

    /// Records that a run ends because the outcome of a goal is unknown.
    pub(crate) fn mark_unknown(&self, goal_id: &str) -> Result<(), LakeError> {
        self.write(goal_id, TOLD, b"")
    }

    fn open_goal(&self, goal_id: &str) -> Result<OpenGoal, BoxedDiagnostic> {
        let told = self.has(goal_id, TOLD)?;
        let goal_id = goal_id.to_owned();
        if let Some(earlier) = self.read_earlier(&goal_id)? {
            let earlier: EarlierGoal = serde_json::from_slice(&earlier).unwrap_or_default();
            return Ok(OpenGoal {
                goal_id,
                goal: None,
                journal: earlier.journal,
                accepted: true,
                valid_until_unix_ms: u64::MAX,
                told,
                cell: CellFacts {
                    simulated: earlier.simulated,
                    gap: String::new(),
                },
                earlier: Some(earlier.outcome),
            });
        }
        // Of a record that cannot be read, only that the goal may have been sent is known.
        let unread = OpenGoal {
            goal_id: goal_id.clone(),
            accepted: true,
            valid_until_unix_ms: u64::MAX,
            told,
            ..OpenGoal::default()
        };
        let Some(bytes) = self.read(&goal_id, GOAL)? else {
            return Ok(unread);
        };
        let Some(line) = bytes.iter().position(|&byte| byte == b'\n') else {
            return Ok(unread);
        };
        let (facts, message) = bytes.split_at(line + 1);
        let facts = serde_json::from_slice::<GoalLine>(facts);
        let message = GoalMessage::decode(message);
        let (Ok(line), Ok((message, goal))) = (facts, message) else {
            return Ok(unread);
        };
        Ok(OpenGoal {
            accepted: self.has(&goal_id, ACCEPTED)?,
            goal_id,
            goal: Some(goal),
            journal: Some(message.address.journal),
            valid_until_unix_ms: line.valid_until_unix_ms,
            told,
            cell: line.cell,
            earlier: None,
        })
    }

    /// Ids are hexadecimal digits.
    fn file(&self, goal_id: &str, ending: &str) -> Option<PathBuf> {
        let folders = self.folders.as_ref()?;
        Some(folders.cell.join(format!("{goal_id}.{ending}")))
    }

    /// Reads a goal of version 4.
    fn read_earlier(&self, goal_id: &str) -> Result<Option<Vec<u8>>, LakeError> {
        let Some(folders) = &self.folders else {
            return Ok(None);
        };
        match self.read(goal_id, EARLIER)? {
            Some(bytes) => Ok(Some(bytes)),
            None => read(&folders.earlier.join(format!("{goal_id}.{EARLIER}"))),
        }
    }

    fn has(&self, goal_id: &str, ending: &str) -> Result<bool, LakeError> {
        let Some(path) = self.file(goal_id, ending) else {
            return Ok(false);
        };
        let exists = path.try_exists();
        exists.map_err(|source| failed("read", &path, source))
    }

    fn read(&self, goal_id: &str, ending: &str) -> Result<Option<Vec<u8>>, LakeError> {
        match self.file(goal_id, ending) {
            Some(path) => read(&path),
            None => Ok(None),
        }
    }

    fn write(&self, goal_id: &str, ending: &str, bytes: &[u8]) -> Result<(), LakeError> {
        match self.file(goal_id, ending) {
            Some(path) => lake::write_atomic(&path, bytes),
            None => Ok(()),
        }
    }

    /// Records a goal before its transmission.
    fn write_goal(
        &self,
        message: &GoalMessage,
        permitted_by: &Capabilities,
    ) -> Result<(), LakeError> {
        let id = &message.encoded.goal_id;
        let Some(goal) = self.file(id, GOAL) else {
            return Ok(());
        };
        // An earlier message may be valid for longer.
        let until = message.address.valid_until_unix_ms;
        let earlier = read(&goal).ok().flatten().and_then(|bytes| {
            let line = bytes.split(|&byte| byte == b'\n').next()?;
            serde_json::from_slice::<GoalLine>(line).ok()
        });
        let line = GoalLine {
            cell: CellFacts::of(permitted_by),
            valid_until_unix_ms: earlier.map_or(until, |line| line.valid_until_unix_ms.max(until)),
        };
        let mut bytes = serde_json::to_vec(&line).unwrap_or_default();
        bytes.push(b'\n');
        bytes.extend_from_slice(&message.bytes);
        lake::write_atomic(&goal, &bytes)?;
        // Only now, so that no crash between the two leaves a goal that counts as never sent.
        for ending in [REFUSED, TOLD] {
            let path = goal.with_extension(ending);
            match fs::remove_file(&path) {
                Err(source) if source.kind() != ErrorKind::NotFound => {
                    let action = "remove";
                    return Err(LakeError::Io {
                        action,
                        path,
                        source,
                    });
                }
                Ok(()) | Err(_) => {}
            }
        }
        let folder = goal.parent().unwrap_or(&goal);
        let synced = File::open(folder).and_then(|folder| folder.sync_all());
        synced.map_err(|source| LakeError::Io {
            action: "write",
            path: folder.to_owned(),
            source,
        })
    }
}

impl SendRecord for Ledger {
    fn sending(
        &self,
        message: &GoalMessage,
        permitted_by: &Capabilities,
    ) -> Result<(), RecordError> {
        self.write_goal(message, permitted_by)
            .map_err(RecordError::new)
    }

    fn refused(&self, goal_id: &str, why: &Rejection) -> Result<(), RecordError> {
        self.write(goal_id, REFUSED, why.reason.as_bytes())
            .map_err(RecordError::new)
    }

    fn accepted(&self, goal_id: &str, acceptance: &Acceptance) -> Result<(), RecordError> {
        self.write(goal_id, ACCEPTED, &acceptance.to_bytes())
            .map_err(RecordError::new)
    }
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, LakeError> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(err) if err.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(failed("read", path, source)),
    }
}

/// Returns the error of a file of the ledger.
pub(crate) fn failed(action: &'static str, path: &Path, source: io::Error) -> LakeError {
    LakeError::Io {
        action,
        path: path.to_owned(),
        source,
    }
}
