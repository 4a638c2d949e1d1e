//! Records of runs, by number, and the lists of units that they share.

use std::{
    collections::{BTreeMap, BTreeSet},
    env,
    path::{Path, PathBuf},
};

use dataflow::{Digest, FileRef, RunRecord, UnitRef};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError, atomic,
    clock::{host, nanoseconds, now},
    folder::{Lake, names_in},
    lock, sealed, twice,
};

/// How the names of runs' files end.
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

/// Numbers of all runs, in order. A record that is there only once counts if it is that of a run: one
/// that was lost elsewhere, and not a file that somebody put here.
pub(crate) fn numbers(root: &Path) -> Result<Vec<u64>, LakeError> {
    let folder = folder(root);
    let number = |name: &String| name.strip_suffix(ENDING)?.parse().ok();
    let numbers_in = |folder: &Path| -> Result<BTreeSet<u64>, LakeError> {
        Ok(names_in(folder)?.iter().filter_map(number).collect())
    };
    let (here, copied) = (
        numbers_in(&folder)?,
        numbers_in(&twice::copy_of(root, &folder))?,
    );
    let all = here.union(&copied).copied();
    let is_run = |number: &u64| {
        (here.contains(number) && copied.contains(number)) || read(root, *number).is_ok()
    };
    Ok(all.filter(is_run).collect())
}

/// Keeps the record of a run that begins, under the next number.
pub(crate) fn begin(lake: &Lake, record: &RunRecord) -> Result<Run, LakeError> {
    let _turn = lock::wait_for(&lake.locks(), "runs", "a record of its run", &|_| {})?;
    let number = numbers(lake.root())?.last().copied().unwrap_or(0) + 1;
    let mut run = Run::begin(number, record.clone());
    keep_progress(lake, &mut run, record.clone())?;
    Ok(run)
}

/// Keeps what a run has done so far.
pub(crate) fn keep_progress(
    lake: &Lake,
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
    run.manifest = Some(keep_manifest(lake, &units)?);
    run.record = record;
    keep(lake, run)
}

/// Keeps the record of a run that ends.
pub(crate) fn end(
    lake: &Lake,
    mut run: Run,
    record: RunRecord,
    history: BTreeMap<String, FileRef>,
) -> Result<(), LakeError> {
    run.history = history;
    keep_progress(lake, &mut run, record)
}

/// Writes a run's record.
pub(crate) fn keep(lake: &Lake, run: &Run) -> Result<(), LakeError> {
    let path = path(lake.root(), run.number);
    twice::write(lake, &path, &sealed::seal(&path, run)?)
}

/// Returns a list of units, none of them made now, as it is kept, and its digest.
pub(crate) fn manifest_of(root: &Path, units: &[UnitRef]) -> Result<(Vec<u8>, Digest), LakeError> {
    let bytes = serde_json::to_vec(units).map_err(|source| LakeError::Json {
        path: manifests(root),
        source,
    })?;
    let digest = Digest::of_bytes(&bytes);
    Ok((bytes, digest))
}

fn keep_manifest(lake: &Lake, units: &[UnitRef]) -> Result<Digest, LakeError> {
    let (bytes, digest) = manifest_of(lake.root(), units)?;
    let path = manifest_path(lake.root(), &digest);
    let is_there = |path: &Path| -> Result<bool, LakeError> {
        Ok(atomic::read_if_there(path)?.is_some_and(|there| there == bytes))
    };
    if !(is_there(&path)? && is_there(&twice::copy_of(lake.root(), &path))?) {
        twice::write(lake, &path, &bytes)?;
    }
    Ok(digest)
}

fn manifest_path(root: &Path, digest: &Digest) -> PathBuf {
    manifests(root).join(format!("{digest}{ENDING}"))
}

/// Whether bytes are the list of units that their file's name promises.
pub(crate) fn is_manifest(path: &Path, bytes: &[u8]) -> bool {
    let promised = path
        .file_stem()
        .and_then(|name| name.to_str()?.parse().ok());
    promised == Some(Digest::of_bytes(bytes))
}

/// Reads a run without its units.
pub(crate) fn read(root: &Path, number: u64) -> Result<Run, LakeError> {
    let run = twice::read(root, &path(root, number), |path, bytes| {
        parse(root, path, bytes)
    })?;
    run.ok_or_else(|| LakeError::NoRun {
        name: number.to_string(),
    })
}

/// Returns the run that a file's bytes hold, if it is the one that the file's name promises.
pub(crate) fn parse(root: &Path, at: &Path, bytes: &[u8]) -> Result<Run, LakeError> {
    let run: Run = sealed::parse(at, bytes)?;
    let path = path(root, run.number);
    if at == path || at == twice::copy_of(root, &path) {
        Ok(run)
    } else {
        Err(LakeError::Damaged {
            path: at.to_owned(),
        })
    }
}

/// Reads the units of a run.
pub(crate) fn units(root: &Path, run: &Run) -> Result<Vec<UnitRef>, LakeError> {
    let Some(digest) = run.manifest else {
        return Ok(Vec::new());
    };
    let path = manifest_path(root, &digest);
    let read = twice::read(root, &path, |path, bytes| {
        if !is_manifest(path, bytes) {
            return Err(LakeError::Damaged {
                path: path.to_owned(),
            });
        }
        serde_json::from_slice(bytes).map_err(|source| LakeError::Json {
            path: path.to_owned(),
            source,
        })
    })?;
    let mut units: Vec<UnitRef> = read.ok_or(LakeError::Lost { path })?;
    for &idx in &run.made_now {
        if let Some(unit) = units.get_mut(idx) {
            unit.made_now = true;
        }
    }
    Ok(units)
}
