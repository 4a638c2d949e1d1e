//! Runs that a later one went through again without making anything: they count as the newest then,
//! and are not recorded a second time.

use std::path::{Path, PathBuf};

use dataflow::{RunRecord, RunStatus};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    folder::Lake,
    runs::{self, manifest_of},
    sealed, twice,
};

/// The run that was gone through again last.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Again {
    /// Its number.
    run: u64,
    /// The greatest number at that time: a run that begins later is newer.
    newest: u64,
}

/// Where it lies.
pub(crate) fn path(root: &Path) -> PathBuf {
    root.join("again.json")
}

/// Returns the run that a file's bytes name.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Again, LakeError> {
    sealed::parse(path, bytes)
}

/// Lets the newest finished run that found exactly these units count as the newest of all; returns
/// its number, or `None` if there is no such run.
pub(crate) fn find(lake: &Lake, record: &RunRecord) -> Result<Option<u64>, LakeError> {
    let root = lake.root();
    let numbers = runs::numbers(root)?;
    let (_, manifest) = manifest_of(root, &record.units)?;
    for &number in numbers.iter().rev() {
        // A damaged record of a run is no run that could be meant.
        let Ok(run) = runs::read(root, number) else {
            continue;
        };
        if run.manifest != Some(manifest)
            || run.record.pipeline != record.pipeline
            || run.record.stages != record.stages
            || run.record.status != RunStatus::Finished
        {
            continue;
        }
        if ordered(root)?.last() != Some(&number) {
            let newest = numbers.last().copied().unwrap_or(number);
            let again = Again {
                run: number,
                newest,
            };
            lake.prepare()?;
            let path = path(root);
            twice::write(lake, &path, &sealed::seal(&path, &again)?)?;
        }
        return Ok(Some(number));
    }
    Ok(None)
}

/// Numbers of all runs, the newest last: in their order, but for one that was gone through again.
pub(crate) fn ordered(root: &Path) -> Result<Vec<u64>, LakeError> {
    let mut numbers = runs::numbers(root)?;
    if let Some(again) = twice::read(root, &path(root), parse)?
        && let Some(place) = numbers.iter().position(|&number| number == again.run)
    {
        numbers.remove(place);
        // Runs that began later are newer.
        let place = numbers.partition_point(|&number| number <= again.newest);
        numbers.insert(place, again.run);
    }
    Ok(numbers)
}
