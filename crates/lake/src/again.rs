//! Runs that a later one went through again without making anything: they count as the newest then,
//! and are not recorded a second time.

use std::path::Path;

use dataflow::{RunRecord, RunStatus};
use serde::{Deserialize, Serialize};

use crate::{LakeError, folder::Folder, register::Register, sealed, twice};

/// The run that was gone through again last.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Again {
    /// Its number.
    run: u64,
    /// The greatest number at that time: a run that begins later is newer.
    newest: u64,
}

/// Returns the run that a file's bytes name.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Again, LakeError> {
    sealed::parse(path, bytes)
}

impl Again {
    /// Keeps it.
    pub(crate) fn keep(&self, folder: &Folder) -> Result<(), LakeError> {
        let path = folder.again();
        twice::write(folder, &path, &sealed::seal(&path, self)?)
    }
}

impl Register {
    /// Returns the number of the newest finished run that found exactly these units; with it what is to
    /// be kept for it to count as the newest of all, unless it does.
    pub(crate) fn find_again(
        &self,
        record: &RunRecord,
    ) -> Result<Option<(u64, Option<Again>)>, LakeError> {
        let numbers = self.numbers()?;
        let (_, manifest) = self.manifest_of(&record.units)?;
        for &number in numbers.iter().rev() {
            // A damaged record of a run is no run that could be meant.
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
            let again = Again {
                run: number,
                newest,
            };
            return Ok(Some((number, (!is_newest).then_some(again))));
        }
        Ok(None)
    }

    /// Numbers of all runs, the newest last: in their order, but for one that was gone through again.
    pub(crate) fn ordered(&self) -> Result<Vec<u64>, LakeError> {
        let mut numbers = self.numbers()?;
        let folder = self.folder();
        if let Some(again) = twice::read(folder, &folder.again(), parse)?
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
