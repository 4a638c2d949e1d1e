//! The register of runs: their records, by number, and the lists of units that they share.

use std::{
    collections::{BTreeMap, BTreeSet},
    env,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard},
};

use ::clock::lock;
use dataflow::{Digest, FileRef, NodeName, RunRecord, RunStatus, UnitRef};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError, atomic,
    clock::{host, nanoseconds, now, program},
    folder::{Folder, HISTORY, digest_named, names_in},
    lock::Locks,
    replicas, sealed,
};

/// Extension of runs' files.
const ENDING: &str = ".json";

/// A run in the lake.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Its number: runs are numbered from 1 in the order in which they began.
    pub number: u64,
    /// When it began, in nanoseconds since 1970.
    pub started_ns: u64,
    /// The machine's name.
    pub host: String,
    /// The working directory: the base of relative paths in its record.
    pub folder: PathBuf,
    /// The process's name, under which it holds a lock while it runs.
    pub(crate) process: String,
    /// The program and its version.
    pub program: String,
    /// Its record. The units are stored separately and read with [`crate::Lake::run`].
    pub record: RunRecord,
    /// Digest of the list of its units.
    pub(crate) manifest: Option<Digest>,
    /// Positions in that list of the units that it made itself.
    pub(crate) made_now: Vec<usize>,
    /// Its rows of the tables of runs, by table.
    pub(crate) history: BTreeMap<String, FileRef>,
}

impl Run {
    /// The name of its file.
    fn file(number: u64) -> String {
        format!("{number:06}{ENDING}")
    }

    /// Describes a run that begins now.
    fn begin(number: u64, record: RunRecord) -> Self {
        Self {
            number,
            started_ns: nanoseconds(now()),
            host: host(),
            folder: env::current_dir().unwrap_or_default(),
            process: atomic::process_name(),
            program: program(),
            record,
            manifest: None,
            made_now: Vec::new(),
            history: BTreeMap::new(),
        }
    }

    /// Whether its rows are of the tables of runs, and of no others.
    pub(crate) fn has_known_tables(&self) -> bool {
        let mut tables = self.history.keys();
        tables.all(|table| HISTORY.contains(&table.as_str()))
    }

    /// The nodes that it has published.
    pub(crate) fn published(&self) -> impl Iterator<Item = &NodeName> {
        let nodes = self.record.nodes.iter().filter(|node| node.published);
        nodes.map(|node| &node.node)
    }

    /// The column of partitions' keys of a node.
    pub(crate) fn column_of(&self, node: &NodeName) -> Option<&str> {
        let mut outputs = self.record.outputs.iter();
        let output = outputs.find(|output| output.node == *node)?;
        Some(&output.partition)
    }
}

/// The runs of a lake.
pub(crate) struct Register {
    folder: Folder,
    /// The run of this process.
    current: Mutex<Option<Run>>,
}

impl Register {
    pub(crate) fn new(folder: Folder) -> Self {
        Self {
            folder,
            current: Mutex::default(),
        }
    }

    pub(crate) fn folder(&self) -> &Folder {
        &self.folder
    }

    /// The run of this process.
    pub(crate) fn current(&self) -> MutexGuard<'_, Option<Run>> {
        lock(&self.current)
    }

    /// Path of a run's record.
    pub(crate) fn path(&self, number: u64) -> PathBuf {
        self.folder.runs().join(Run::file(number))
    }

    /// Numbers of all runs, in order. A record without its copy counts only if it parses as a
    /// run's: then the copy was lost, and the file is not foreign.
    pub(crate) fn numbers(&self) -> Result<Vec<u64>, LakeError> {
        let folder = self.folder.runs();
        let number = |name: &String| name.strip_suffix(ENDING)?.parse().ok();
        let numbers_in = |folder: &Path| -> Result<BTreeSet<u64>, LakeError> {
            Ok(names_in(folder)?.iter().filter_map(number).collect())
        };
        let here = numbers_in(&folder)?;
        let copied = numbers_in(&self.folder.copy_of(&folder))?;
        let all = here.union(&copied).copied();
        let is_run = |number: &u64| {
            (here.contains(number) && copied.contains(number)) || self.read(*number).is_ok()
        };
        Ok(all.filter(is_run).collect())
    }

    /// Reads a run without its units.
    pub(crate) fn read(&self, number: u64) -> Result<Run, LakeError> {
        let run = replicas::read(&self.folder, &self.path(number), |path, bytes| {
            self.parse(path, bytes)
        })?;
        run.ok_or_else(|| LakeError::NoRun {
            name: number.to_string(),
        })
    }

    /// Reads a run without its units. A run whose process died is marked as interrupted.
    pub(crate) fn read_with_end(&self, number: u64, locks: &Locks) -> Result<Run, LakeError> {
        let mut run = self.read(number)?;
        if run.record.status == RunStatus::Running && !locks.is_alive(&run.process) {
            run.record.status = RunStatus::Interrupted;
        }
        Ok(run)
    }

    /// Parses a run from a file's bytes, if it matches the file's name.
    pub(crate) fn parse(&self, at: &Path, bytes: &[u8]) -> Result<Run, LakeError> {
        let run: Run = sealed::parse(at, bytes)?;
        let path = self.path(run.number);
        let is_here = at == path || at == self.folder.copy_of(&path);
        if is_here && run.has_known_tables() {
            Ok(run)
        } else {
            Err(LakeError::damaged(at))
        }
    }

    /// Reads the units of a run.
    pub(crate) fn units(&self, run: &Run) -> Result<Vec<UnitRef>, LakeError> {
        let Some(digest) = run.manifest else {
            return Ok(Vec::new());
        };
        let path = self.manifest_path(&digest);
        let read = replicas::read(&self.folder, &path, |path, bytes| {
            check_manifest(path, bytes)?;
            serde_json::from_slice(bytes).map_err(LakeError::json(path))
        })?;
        let mut units: Vec<UnitRef> = read.ok_or(LakeError::Lost { path })?;
        for &idx in &run.made_now {
            if let Some(unit) = units.get_mut(idx) {
                unit.made_now = true;
            }
        }
        Ok(units)
    }

    /// Stores the record of a new run under the next number, and returns the number.
    pub(crate) fn begin(&self, record: &RunRecord, locks: &Locks) -> Result<u64, LakeError> {
        let _turn = locks.lock_numbering()?;
        let number = self.numbers()?.last().copied().unwrap_or(0) + 1;
        let mut run = Run::begin(number, record.clone());
        self.keep_progress(&mut run, record.clone())?;
        *self.current() = Some(run);
        Ok(number)
    }

    /// Updates the record of a running run.
    pub(crate) fn keep_progress(
        &self,
        run: &mut Run,
        mut record: RunRecord,
    ) -> Result<(), LakeError> {
        let mut units = std::mem::take(&mut record.units);
        run.made_now = units
            .iter()
            .enumerate()
            .filter(|(_, unit)| unit.made_now)
            .map(|(idx, _)| idx)
            .collect();
        for unit in &mut units {
            unit.made_now = false;
        }
        run.manifest = Some(self.keep_manifest(&units)?);
        run.record = record;
        self.keep(run)
    }

    /// Stores the final record of a run.
    pub(crate) fn end(
        &self,
        mut run: Run,
        record: RunRecord,
        history: BTreeMap<String, FileRef>,
    ) -> Result<(), LakeError> {
        run.history = history;
        self.keep_progress(&mut run, record)
    }

    /// Writes a run's record.
    pub(crate) fn keep(&self, run: &Run) -> Result<(), LakeError> {
        let path = self.path(run.number);
        replicas::write(&self.folder, &path, &sealed::seal(&path, run)?)
    }

    /// Returns the stored form of a list of units, with `made_now` cleared, and its digest.
    pub(crate) fn manifest_of(&self, units: &[UnitRef]) -> Result<(Vec<u8>, Digest), LakeError> {
        let bytes = serde_json::to_vec(units).map_err(LakeError::json(&self.folder.manifests()))?;
        let digest = Digest::of_bytes(&bytes);
        Ok((bytes, digest))
    }

    fn keep_manifest(&self, units: &[UnitRef]) -> Result<Digest, LakeError> {
        let (bytes, digest) = self.manifest_of(units)?;
        let path = self.manifest_path(&digest);
        let is_there = |path: &Path| -> Result<bool, LakeError> {
            Ok(atomic::read_if_there(path)?.is_some_and(|there| there == bytes))
        };
        if !(is_there(&path)? && is_there(&self.folder.copy_of(&path))?) {
            replicas::write(&self.folder, &path, &bytes)?;
        }
        Ok(digest)
    }

    fn manifest_path(&self, digest: &Digest) -> PathBuf {
        let name = format!("{digest}{ENDING}");
        self.folder.manifests().join(name)
    }
}

/// Checks that bytes are the list of units that the file is named after.
pub(crate) fn check_manifest(path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
    if digest_named(path) == Some(Digest::of_bytes(bytes)) {
        Ok(())
    } else {
        Err(LakeError::damaged(path))
    }
}
