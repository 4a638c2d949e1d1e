//! Goals that version 4 of the protocol recorded: taken over once, and never sent again.
//!
//! Version 4 kept notes of open goals with the resume state of units, which do not name the cell, and
//! executed ones only in the table `executions`. Their ids are those of this version.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use dataflow::{Artifact, BoxedDiagnostic, Digest};
use lake::{Lake, LakeError};
use schemas::{
    Table,
    executions::{Execution, Executions, Outcome},
};
use serde::{Deserialize, Serialize};

use crate::{config::SIMULATED, ledger::failed};

/// Says that the goals were taken over.
const TAKEN_OVER: &str = "taken_over";
/// Name of the folder of resume state, below the lake.
const RESUME: &str = "resume";
/// Prefix of the folder of a unit's table, before its fingerprint.
const FINGERPRINT: &str = "fingerprint=";

/// A goal that version 4 recorded.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct EarlierGoal {
    /// The cell, if that was recorded.
    pub(crate) cell: Option<String>,
    pub(crate) goal_id: String,
    /// The journal that it was sent to, if that was recorded.
    pub(crate) journal: Option<String>,
    pub(crate) simulated: bool,
    /// The recorded outcome, for people.
    pub(crate) outcome: String,
}

/// Has every goal that version 4 recorded in the lake kept, once.
pub(crate) fn take_over(
    effects: &Path,
    keep: impl Fn(&EarlierGoal) -> Result<(), LakeError>,
) -> Result<(), BoxedDiagnostic> {
    let done = effects.join(TAKEN_OVER);
    if done.exists() {
        return Ok(());
    }
    // `LAKE/effects/dispatch`.
    let lake = effects.parent().and_then(Path::parent);
    if let Some(root) = lake.filter(|root| root.join("units").is_dir()) {
        let lake = Lake::open(root);
        for goal in noted(root)?.iter().chain(&executed(&lake)?) {
            keep(goal)?;
        }
    }
    Ok(lake::write_atomic(&done, b"version 4\n")?)
}

/// Goals of interrupted units: they may have ended, at whichever cell.
fn noted(root: &Path) -> Result<Vec<EarlierGoal>, BoxedDiagnostic> {
    let mut goals = Vec::new();
    for folder in folders_of(&root.join(RESUME))? {
        for path in files_of(&folder, "sent")? {
            let journal = fs::read_to_string(&path).map_err(|err| failed("read", &path, err))?;
            goals.push(EarlierGoal {
                cell: None,
                goal_id: stem(&path),
                journal: Some(journal),
                simulated: false,
                outcome: "sent".to_owned(),
            });
        }
    }
    Ok(goals)
}

/// Goals in tables of executions, but those at cells that ended with their run.
fn executed(lake: &Lake) -> Result<Vec<EarlierGoal>, BoxedDiagnostic> {
    let mut goals = Vec::new();
    for object in folders_of(&lake.versions(Executions::NAME))? {
        for unit in folders_of(&object)? {
            let name = unit.file_name().and_then(|name| name.to_str());
            let digest = name.and_then(|name| name.strip_prefix(FINGERPRINT)?.parse().ok());
            let is_lasting = match &digest {
                Some(digest) => is_at_lasting_cell(lake, digest)?,
                None => true,
            };
            let path = unit.join(lake::table::FILE);
            if !is_lasting || !path.exists() {
                continue;
            }
            let Ok(key) = "all".parse() else {
                unreachable!("`all` is a key");
            };
            let rows: Executions = lake::table::read(&Artifact {
                key,
                labels: BTreeMap::new(),
                files: BTreeMap::from([(lake::table::FILE.to_owned(), path)]),
            })?;
            let is_sent =
                |row: &Execution| !row.goal_id.is_empty() && row.outcome != Outcome::Rejected;
            goals.extend(rows.into_iter().filter(is_sent).map(|row| EarlierGoal {
                cell: Some(row.cell),
                goal_id: row.goal_id,
                journal: None,
                simulated: row.simulated,
                outcome: row.outcome.as_str().to_owned(),
            }));
        }
    }
    Ok(goals)
}

/// Whether a unit may have sent its goals to a cell that outlived the run.
fn is_at_lasting_cell(lake: &Lake, unit: &Digest) -> Result<bool, BoxedDiagnostic> {
    let record = lake.record(unit)?;
    Ok(record.is_none_or(|record| {
        let cell = record.fingerprint.recipe.config.get("cell");
        cell.is_none_or(|cell| cell != SIMULATED)
    }))
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn folders_of(path: &Path) -> Result<Vec<PathBuf>, BoxedDiagnostic> {
    let mut entries = entries_of(path)?;
    entries.retain(|entry| entry.is_dir());
    Ok(entries)
}

fn files_of(path: &Path, ending: &str) -> Result<Vec<PathBuf>, BoxedDiagnostic> {
    let mut entries = entries_of(path)?;
    entries.retain(|entry| entry.extension().is_some_and(|found| found == ending));
    Ok(entries)
}

/// Returns what is in a folder, in the order of names; nothing if there is no such folder.
fn entries_of(path: &Path) -> Result<Vec<PathBuf>, BoxedDiagnostic> {
    if !path.is_dir() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(path).map_err(|err| failed("read", path, err))?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths: Vec<PathBuf> = paths
        .collect::<Result<_, _>>()
        .map_err(|err| failed("read", path, err))?;
    paths.sort();
    Ok(paths)
}
