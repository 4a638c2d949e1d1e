//! The goal journal: keeps a cell from executing a goal twice, even after it was killed and
//! restarted.
//!
//! In the journal's folder, `<goal id>.goal` is the goal as received, written before the cell
//! acknowledges it, and `<goal id>.report` its report. A goal without a report was executing when
//! the cell went down: its progress is lost, so its report is `unknown`. `taken` lists the goals in
//! order of acceptance, below the journal's own name. `kind` says whether the machine is simulated or
//! real: what a simulation did is nothing that a robot did. `key` holds the private key with which the
//! cell signs its answers; the journal's name is the public key.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    io::{self, BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{Instant, UNIX_EPOCH},
};

use zenoh::query::Query;

use crate::{
    CellError, EncodedGoal, Goal, GoalMessage, GoalOutcome, Rejection, RejectionCode, SigningKey,
    message::now,
    outcome::{Outcomes, OutcomesHeader},
    report::{Ending, Report},
};

const GOAL: &str = "goal";
const REPORT: &str = "report";
/// Lock file, held while a cell uses the folder.
const LOCK: &str = "lock";
/// The list of accepted goals.
const TAKEN: &str = "taken";
/// File that says whether the machine is simulated or real.
const KIND: &str = "kind";
/// Outcomes per answer: few enough not to delay other queries.
const OUTCOMES: usize = 64;

/// Returns a unique name for a cell's stream.
pub(super) fn fresh_name() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let since = now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut hasher = blake3::Hasher::new();
    hasher.update(&since.as_nanos().to_le_bytes());
    hasher.update(&process::id().to_le_bytes());
    hasher.update(&COUNT.fetch_add(1, Ordering::Relaxed).to_le_bytes());
    let name = hasher.finalize().to_hex();
    name.chars().take(NAME).collect()
}

/// Digits of such a name.
const NAME: usize = 16;

/// An accepted goal that waits for the robot.
pub(super) struct Job {
    pub(super) encoded: EncodedGoal,
    pub(super) goal: Goal,
    /// Time of arrival.
    pub(super) received: Instant,
}

/// Every accepted goal, by id. Ids are derived from the content, so one id is one content.
pub(super) struct Journal {
    key: Arc<SigningKey>,
    entries: BTreeMap<String, Entry>,
    /// The ids in order of acceptance.
    taken: Vec<String>,
    /// Outcomes of goals, as far as they were queried.
    endings: BTreeMap<String, GoalOutcome>,
    folder: Option<Folder>,
}

struct Folder {
    path: PathBuf,
    /// The list, open for appending.
    taken: File,
    /// Whether the list's last line may be incomplete.
    torn: bool,
    _lock: File,
}

/// Answer to a report query.
pub(super) enum Lookup {
    /// Kept: it is answered when the motion ends.
    Kept,
    /// Answer with this report.
    Over(Query, Vec<u8>),
    /// Answer that no such goal was accepted.
    NeverTaken(Query),
}

enum Entry {
    /// The robot moves; these queries wait for the end.
    Executing(Vec<Query>),
    /// The motion has ended, with this report.
    Done(Vec<u8>),
    /// The motion has ended; the report is in the folder.
    Stored,
}

impl Journal {
    /// Creates a journal that is kept in memory only.
    ///
    /// # Errors
    ///
    /// Fails if the system's random number generator does.
    pub(super) fn in_memory() -> Result<Self, CellError> {
        Ok(Self {
            key: Arc::new(SigningKey::fresh().map_err(CellError::Random)?),
            entries: BTreeMap::new(),
            taken: Vec::new(),
            endings: BTreeMap::new(),
            folder: None,
        })
    }

    /// Opens the journal in a folder, creating it if it is missing, for a machine that is simulated or real.
    pub(super) fn open(path: &Path, simulated: bool) -> Result<Self, CellError> {
        let failed = |source: io::Error| CellError::Journal {
            path: path.to_owned(),
            source,
        };
        fs::create_dir_all(path).map_err(failed)?;
        let lock = File::create(path.join(LOCK)).map_err(failed)?;
        lock.try_lock().map_err(|err| failed(err.into()))?;
        let mut entries = BTreeMap::new();
        for entry in fs::read_dir(path).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            let id = file.file_stem().and_then(|stem| stem.to_str());
            if file.extension().is_none_or(|ending| ending != GOAL) {
                continue;
            }
            let Some(id) = id else { continue };
            if !file.with_extension(REPORT).try_exists().map_err(failed)? {
                let message = "the cell went down during this motion; look at the robot";
                let report = Report::unknown(id, message.to_owned()).to_bytes();
                lake::write_atomic(&file.with_extension(REPORT), &report)
                    .map_err(|err| failed(io::Error::other(err)))?;
            }
            entries.insert(id.to_owned(), Entry::Stored);
        }
        let list = path.join(TAKEN);
        if entries.is_empty() && !list.try_exists().map_err(failed)? {
            // A key whose goals are lost would pass for the journal that knows them.
            SigningKey::discard(path).map_err(failed)?;
        }
        check_kind(path, simulated)?;
        let key = SigningKey::open(path).map_err(failed)?;
        let taken = list_of(&list, &entries).map_err(failed)?;
        let mut text = format!("{}\n", key.name());
        text.extend(taken.iter().map(|id| format!("{id}\n")));
        lake::write_atomic(&list, text.as_bytes()).map_err(|err| failed(io::Error::other(err)))?;
        let continued = File::options().append(true).open(&list).map_err(failed)?;
        Ok(Self {
            key: Arc::new(key),
            entries,
            taken,
            endings: BTreeMap::new(),
            folder: Some(Folder {
                path: path.to_owned(),
                taken: continued,
                torn: false,
                _lock: lock,
            }),
        })
    }

    /// Returns the key that signs answers.
    pub(super) fn key(&self) -> Arc<SigningKey> {
        Arc::clone(&self.key)
    }

    /// Records a goal; returns whether it is to be executed now, being new.
    pub(super) fn admit(&mut self, message: &GoalMessage) -> Result<bool, Rejection> {
        let goal_id = &message.encoded.goal_id;
        if self.knows(goal_id) {
            return Ok(false);
        }
        self.is_free()?;
        let refused = |err: String| {
            let reason = format!("the cell cannot write down that it takes the goal: {err}");
            Rejection::new(RejectionCode::Storage, reason)
        };
        if let Some(path) = self.file(goal_id, GOAL) {
            lake::write_atomic(&path, &message.bytes).map_err(|err| refused(err.to_string()))?;
            if let Err(err) = self.list(goal_id) {
                // A refused goal was not accepted. If not even the removal succeeds, a restarted
                // cell reports it as unknown.
                let _removed = fs::remove_file(path);
                return Err(refused(err.to_string()));
            }
        }
        self.taken.push(goal_id.clone());
        self.entries
            .insert(goal_id.clone(), Entry::Executing(Vec::new()));
        Ok(true)
    }

    /// Fails while a goal is executing.
    pub(super) fn is_free(&self) -> Result<(), Rejection> {
        match self.executing() {
            None => Ok(()),
            Some(id) => Err(Rejection::new(
                RejectionCode::Busy,
                format!("the cell executes goal {id}"),
            )),
        }
    }

    /// Returns whether the goal was accepted before.
    pub(super) fn knows(&self, goal_id: &str) -> bool {
        self.entries.contains_key(goal_id)
    }

    /// Returns the executing goal.
    pub(super) fn executing(&self) -> Option<&str> {
        let mut entries = self.entries.iter();
        let found = entries.find(|(_, entry)| matches!(entry, Entry::Executing(_)));
        found.map(|(id, _)| id.as_str())
    }

    /// Handles a report query: keeps it while the robot moves, else returns it with the answer.
    pub(super) fn ask(&mut self, goal_id: &str, query: Query) -> Lookup {
        let file = self.file(goal_id, REPORT);
        match self.entries.get_mut(goal_id) {
            None => Lookup::NeverTaken(query),
            Some(Entry::Executing(waiting)) => {
                waiting.push(query);
                Lookup::Kept
            }
            Some(Entry::Done(report)) => Lookup::Over(query, report.clone()),
            Some(Entry::Stored) => {
                let report = file.and_then(|file| fs::read(file).ok());
                let report = report.unwrap_or_else(|| {
                    let message = "the cell has lost its report on this motion";
                    Report::unknown(goal_id, message.to_owned()).to_bytes()
                });
                Lookup::Over(query, report)
            }
        }
    }

    /// Records a goal's report; returns the queries that wait for it.
    pub(super) fn conclude(&mut self, goal_id: &str, report: Vec<u8>) -> Vec<Query> {
        // A report that cannot be written is kept in memory: this cell can answer, a restarted one
        // will say `unknown`.
        let path = self.file(goal_id, REPORT);
        let stored = path.is_some_and(|path| lake::write_atomic(&path, &report).is_ok());
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

    /// Returns the outcome of a goal; none if it is executing or was not accepted.
    pub(super) fn outcome(&mut self, goal_id: &str) -> Option<GoalOutcome> {
        let result_n = self.taken.iter().rposition(|id| id == goal_id)?;
        self.ended(result_n)
    }

    /// Returns outcomes in order of acceptance, from a number on: at most one answer's worth.
    pub(super) fn outcomes(&mut self, from: u64) -> Outcomes {
        let from = usize::try_from(from).unwrap_or(usize::MAX);
        let until = self.taken.len().min(from.saturating_add(OUTCOMES));
        Outcomes {
            header: OutcomesHeader {
                journal: self.key.name().to_owned(),
                results_n: self.executed_count() as u64,
            },
            outcomes: (from..until)
                .map_while(|result_n| self.ended(result_n))
                .collect(),
        }
    }

    fn ended(&mut self, result_n: usize) -> Option<GoalOutcome> {
        let goal_id = self.taken.get(result_n)?;
        if let Some(known) = self.endings.get(goal_id) {
            return Some(known.clone());
        }
        let ending = match self.entries.get(goal_id)? {
            Entry::Executing(_) => return None,
            Entry::Done(report) => Ending::read(report),
            Entry::Stored => self
                .file(goal_id, REPORT)
                .and_then(|file| first_line(&file).ok())
                .and_then(|line| Ending::read(&line)),
        };
        let ending = ending.unwrap_or_else(Ending::lost);
        let outcome = GoalOutcome {
            journal: self.key.name().to_owned(),
            result_n: result_n as u64,
            goal_id: goal_id.clone(),
            outcome: ending.outcome,
            message: ending.message,
            lift_m: ending.lift_m,
        };
        self.endings.insert(goal_id.clone(), outcome.clone());
        Some(outcome)
    }

    /// Appends to the list of accepted goals.
    fn list(&mut self, goal_id: &str) -> io::Result<()> {
        let Some(folder) = &mut self.folder else {
            return Ok(());
        };
        let begin = if folder.torn { "\n" } else { "" };
        let line = format!("{begin}{goal_id}\n");
        folder.torn = true;
        folder.taken.write_all(line.as_bytes())?;
        folder.torn = false;
        folder.taken.sync_data()
    }

    /// Returns the number of goals that have ended.
    pub(super) fn executed_count(&self) -> usize {
        let done = |entry: &&Entry| !matches!(entry, Entry::Executing(_));
        self.entries.values().filter(done).count()
    }

    /// Ids are hexadecimal digits: they come from a checked digest.
    fn file(&self, goal_id: &str, ending: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        Some(folder.path.join(format!("{goal_id}.{ending}")))
    }
}

/// Checks that a journal is of a machine of this kind, and notes the kind of a new one.
fn check_kind(path: &Path, simulated: bool) -> Result<(), CellError> {
    let failed = |source: io::Error| CellError::Journal {
        path: path.to_owned(),
        source,
    };
    let file = path.join(KIND);
    let (simulated_word, real) = ("simulated\n", "real\n");
    let word = if simulated { simulated_word } else { real };
    match fs::read_to_string(&file) {
        Ok(found) if found == word => Ok(()),
        Ok(found) => Err(CellError::JournalKind {
            path: path.to_owned(),
            simulated: found == simulated_word,
        }),
        // Journals of version 4 name no kind.
        Err(err) if err.kind() == io::ErrorKind::NotFound => {
            let written = lake::write_atomic(&file, word.as_bytes());
            written.map_err(|err| failed(io::Error::other(err)))
        }
        Err(err) => Err(failed(err)),
    }
}

/// Reads the list of accepted goals: each existing goal once; goals missing from the list come
/// last.
fn list_of(path: &Path, entries: &BTreeMap<String, Entry>) -> io::Result<Vec<String>> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(err) if err.kind() == io::ErrorKind::NotFound => String::new(),
        Err(err) => return Err(err),
    };
    let mut lines = text.lines();
    let _name = lines.next();
    let mut listed = BTreeSet::new();
    // A line may be incomplete, or name a goal that was refused after all; of two equal lines the
    // later one counts.
    let mut taken: Vec<String> = lines
        .rev()
        .filter(|id| entries.contains_key(*id) && listed.insert(*id))
        .map(ToOwned::to_owned)
        .collect();
    taken.reverse();
    let others = entries.keys().filter(|id| !listed.contains(id.as_str()));
    taken.extend(others.cloned());
    Ok(taken)
}

fn first_line(path: &Path) -> io::Result<Vec<u8>> {
    let mut line = Vec::new();
    BufReader::new(File::open(path)?).read_until(b'\n', &mut line)?;
    Ok(line)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use schemas::executions::Outcome;

    use super::*;
    use crate::Address;

    fn message(id: &str) -> GoalMessage {
        let encoded = EncodedGoal {
            goal_id: id.to_owned(),
            digest: id.to_owned(),
            bytes: b"goal".to_vec(),
        };
        let address = Address::now("lab", "aa", "me", true, Duration::ZERO);
        GoalMessage::new(encoded, address, &SigningKey::fresh().unwrap())
    }

    #[test]
    fn goal_interrupted_by_a_crash_has_unknown_outcome() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path(), true).unwrap();
        assert!(journal.admit(&message("00")).unwrap());
        journal.conclude("00", Report::aborted("00", "broken".to_owned()).to_bytes());
        assert!(journal.admit(&message("01")).unwrap());
        drop(journal);
        let mut journal = Journal::open(folder.path(), true).unwrap();
        for id in ["00", "01"] {
            assert!(!journal.admit(&message(id)).unwrap());
        }
        let report = |id: &str| {
            let bytes = fs::read(folder.path().join(format!("{id}.report"))).unwrap();
            Ending::read(&bytes).unwrap().outcome
        };
        assert_eq!(
            [report("00"), report("01")],
            [Outcome::Aborted, Outcome::Unknown]
        );
        assert_eq!(journal.executed_count(), 2);
    }

    #[test]
    fn outcome_numbers_survive_restarts() {
        let folder = tempfile::tempdir().unwrap();
        let over = |journal: &mut Journal, id: &str| {
            assert!(journal.admit(&message(id)).unwrap());
            journal.conclude(id, Report::aborted(id, id.to_owned()).to_bytes());
        };
        let ids = |journal: &mut Journal, from: u64| -> Vec<(u64, String)> {
            let outcomes = journal.outcomes(from).outcomes.into_iter();
            outcomes.map(|o| (o.result_n, o.goal_id)).collect()
        };
        let named = |n: u64, id: &str| (n, id.to_owned());
        let mut journal = Journal::open(folder.path(), true).unwrap();
        let name = journal.key.name().to_owned();
        // Not in the order of their names.
        over(&mut journal, "0b");
        over(&mut journal, "0a");
        assert!(journal.admit(&message("0c")).unwrap());
        assert_eq!(ids(&mut journal, 0), [named(0, "0b"), named(1, "0a")]);
        drop(journal);
        // One goal was listed and refused before it was taken, and the cell went down while it wrote
        // the line of another that it did not take.
        let list = folder.path().join(TAKEN);
        let text = fs::read_to_string(&list).unwrap();
        fs::write(&list, text.replace("0b\n", "0c\n0b\n") + "00").unwrap();
        let mut journal = Journal::open(folder.path(), true).unwrap();
        over(&mut journal, "01");
        assert_eq!(journal.key.name(), name);
        assert_eq!(
            ids(&mut journal, 1),
            [named(1, "0a"), named(2, "0c"), named(3, "01")]
        );
        let unknown = journal.outcome("0c").unwrap();
        assert_eq!((unknown.outcome, unknown.result_n), (Outcome::Unknown, 2));
        assert_eq!(journal.outcomes(4).header.results_n, 4);
        assert!(ids(&mut journal, 4).is_empty());
    }

    #[test]
    fn one_folder_serves_one_cell_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::open(folder.path(), true).unwrap();
        assert!(Journal::open(folder.path(), true).is_err());
        drop(journal);
        assert!(Journal::open(folder.path(), true).is_ok());
    }

    #[test]
    fn a_key_without_its_goals_begins_another_journal() {
        let [first, second] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let name = {
            let mut journal = Journal::open(first.path(), true).unwrap();
            assert!(journal.admit(&message("00")).unwrap());
            journal.key.name().to_owned()
        };
        fs::copy(first.path().join("key"), second.path().join("key")).unwrap();
        let other = Journal::open(second.path(), true).unwrap();
        assert_ne!(other.key.name(), name);
        assert_eq!(Journal::open(first.path(), true).unwrap().key.name(), name);
    }

    #[test]
    fn a_simulations_journal_is_not_a_robots() {
        let folder = tempfile::tempdir().unwrap();
        drop(Journal::open(folder.path(), true).unwrap());
        let refused = Journal::open(folder.path(), false).map(drop).unwrap_err();
        assert!(
            matches!(
                refused,
                CellError::JournalKind {
                    simulated: true,
                    ..
                }
            ),
            "{refused}"
        );
        assert!(Journal::open(folder.path(), true).is_ok());
    }

    #[test]
    fn goal_is_rejected_when_the_journal_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path(), true).unwrap();
        // A folder stands where the goal's file would.
        fs::create_dir(folder.path().join("00.goal")).unwrap();
        fs::write(folder.path().join("00.goal/file"), b"").unwrap();
        let refused = journal.admit(&message("00")).unwrap_err();
        assert_eq!(refused.code, RejectionCode::Storage);
        assert!(!journal.knows("00"));
    }
}
