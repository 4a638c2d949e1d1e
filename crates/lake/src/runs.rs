//! Records of runs, by number, and the lists of units that they share.

use std::{
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
};

use dataflow::{Digest, FileRef, RunRecord, UnitRef};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    atomic::{self, io_error},
    clock::{host, nanoseconds, now},
    folder::{Lake, names_in},
    lock, sealed,
};

/// A run in the lake.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Its number: runs are numbered from 1 in the order in which they began.
    pub number: u64,
    /// When it began, in nanoseconds since 1970.
    pub started_ns: u64,
    /// The machine's name.
    pub host: String,
    /// The folder in which it was run: relative paths of its record are meant from there.
    pub folder: PathBuf,
    /// The process's name, under which it holds a lock while it runs.
    pub(crate) process: String,
    /// The program and its version.
    pub program: String,
    /// What it did. The units are kept apart and read with [`Lake::run`].
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
        format!("{number:06}.json")
    }

    /// Describes a run that begins now.
    pub(crate) fn begin(number: u64, record: RunRecord) -> Self {
        Self {
            number,
            started_ns: nanoseconds(now()),
            host: host(),
            folder: env::current_dir().unwrap_or_default(),
            process: atomic::process_name(),
            program: concat!("pipeline ", env!("CARGO_PKG_VERSION")).to_owned(),
            record,
            manifest: None,
            made_now: Vec::new(),
            history: BTreeMap::new(),
        }
    }
}

/// The folder of runs.
pub(crate) fn folder(root: &Path) -> PathBuf {
    root.join("runs")
}

/// The folder of lists of units.
pub(crate) fn manifests(root: &Path) -> PathBuf {
    root.join("manifests")
}

/// Where a run's record lies.
pub(crate) fn path(root: &Path, number: u64) -> PathBuf {
    folder(root).join(Run::file(number))
}

/// Numbers of all runs, in order.
pub(crate) fn numbers(root: &Path) -> Result<Vec<u64>, LakeError> {
    let names = names_in(&folder(root))?;
    let numbers = names
        .iter()
        .filter_map(|name| name.strip_suffix(".json")?.parse().ok());
    let mut numbers: Vec<u64> = numbers.collect();
    numbers.sort_unstable();
    Ok(numbers)
}

/// Keeps the record of a run that begins, under the next number.
pub(crate) fn begin(lake: &Lake, record: &RunRecord) -> Result<Run, LakeError> {
    let _turn = lock::wait_for(&lake.locks(), "runs", "a record of its run", &|_| {})?;
    let number = numbers(lake.root())?.last().copied().unwrap_or(0) + 1;
    let run = Run::begin(number, record.clone());
    sealed::write(&lake.staging(), &path(lake.root(), number), &run)?;
    Ok(run)
}

/// Keeps the record of a run that ends.
pub(crate) fn end(
    lake: &Lake,
    mut run: Run,
    mut record: RunRecord,
    history: BTreeMap<String, FileRef>,
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
    run.manifest = Some(keep_manifest(lake, &units)?);
    run.record = record;
    run.history = history;
    keep(lake, &run)
}

/// Writes a run's record.
pub(crate) fn keep(lake: &Lake, run: &Run) -> Result<(), LakeError> {
    sealed::write(&lake.staging(), &path(lake.root(), run.number), run)
}

fn keep_manifest(lake: &Lake, units: &[UnitRef]) -> Result<Digest, LakeError> {
    let folder = manifests(lake.root());
    let bytes = serde_json::to_vec(units).map_err(|source| LakeError::Json {
        path: folder.clone(),
        source,
    })?;
    let digest = Digest::of_bytes(&bytes);
    let path = folder.join(format!("{digest}.json"));
    let there = atomic::read_if_there(&path)?;
    if there.is_none_or(|there| there != bytes) {
        atomic::write(&lake.staging(), &path, &bytes)?;
    }
    Ok(digest)
}

/// Reads a run without its units.
pub(crate) fn read(root: &Path, number: u64) -> Result<Run, LakeError> {
    let run: Option<Run> = sealed::read(&path(root, number))?;
    run.ok_or_else(|| LakeError::NoRun {
        name: number.to_string(),
    })
}

/// Reads the units of a run.
pub(crate) fn units(root: &Path, run: &Run) -> Result<Vec<UnitRef>, LakeError> {
    let Some(digest) = run.manifest else {
        return Ok(Vec::new());
    };
    let path = manifests(root).join(format!("{digest}.json"));
    let bytes = std::fs::read(&path).map_err(io_error("read", &path))?;
    if Digest::of_bytes(&bytes) != digest {
        return Err(LakeError::Damaged { path });
    }
    let mut units: Vec<UnitRef> =
        serde_json::from_slice(&bytes).map_err(|source| LakeError::Json { path, source })?;
    for &idx in &run.made_now {
        if let Some(unit) = units.get_mut(idx) {
            unit.made_now = true;
        }
    }
    Ok(units)
}
