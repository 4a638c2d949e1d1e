//! Runs repeated by a later one that made nothing: they then count as the newest, and are not
//! recorded a second time.

use std::path::Path;

use dataflow::{RunRecord, RunStatus};
use serde::{Deserialize, Serialize};

use crate::{LakeError, folder::Folder, register::Register, replicas, sealed};

/// The most recently repeated run.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RepeatedRun {
    /// Its number.
    run: u64,
    /// The highest run number at that time: a run that begins later is newer.
    newest: u64,
}

/// Parses the file's bytes.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<RepeatedRun, LakeError> {
    sealed::parse(path, bytes)
}

impl RepeatedRun {
    /// Keeps it.
    pub(crate) fn keep(&self, folder: &Folder) -> Result<(), LakeError> {
        let path = folder.repeated_run();
        replicas::write(folder, &path, &sealed::seal(&path, self)?)
    }
}

impl Register {
    /// Returns the number of the newest finished run with exactly these units, and, unless it
    /// already counts as the newest of all, the mark to store so that it does.
    pub(crate) fn find_repeated(
        &self,
        record: &RunRecord,
    ) -> Result<Option<(u64, Option<RepeatedRun>)>, LakeError> {
        let numbers = self.numbers()?;
        let (_, manifest) = self.manifest_of(&record.units)?;
        for &number in numbers.iter().rev() {
            // A run with a damaged record cannot match.
            let Ok(run) = self.read(number) else {
                continue;
            };
            if run.manifest != Some(manifest)
                || run.record.pipeline != record.pipeline
                || run.record.stages != record.stages
                || run.record.status != RunStatus::Finished
            {
                continue;
            }
            let is_newest = self.ordered()?.last() == Some(&number);
            let newest = numbers.last().copied().unwrap_or(number);
            let again = RepeatedRun {
                run: number,
                newest,
            };
            return Ok(Some((number, (!is_newest).then_some(again))));
        }
        Ok(None)
    }

    /// Numbers of all runs, the newest last: in order, except for a repeated one.
    pub(crate) fn ordered(&self) -> Result<Vec<u64>, LakeError> {
        let mut numbers = self.numbers()?;
        let folder = self.folder();
        if let Some(again) = replicas::read(folder, &folder.repeated_run(), parse)?
            && let Some(place) = numbers.iter().position(|&number| number == again.run)
        {
            numbers.remove(place);
            // Runs that began later are newer.
            let place = numbers.partition_point(|&number| number <= again.newest);
            numbers.insert(place, again.run);
        }
        Ok(numbers)
    }
}
