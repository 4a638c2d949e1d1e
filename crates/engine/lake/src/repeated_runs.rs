//! Runs repeated by a later one that made nothing: they then count as the newest, and are not
//! recorded a second time.

use std::path::Path;

use dataflow::{RunRecord, RunStatus};
use serde::{Deserialize, Serialize};

use crate::{
    LakeError,
    lock::Locks,
    register::{Register, Run},
    replicas, sealed,
};

/// A repeated run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RepeatedRun {
    /// Its number.
    pub(crate) run: u64,
    /// The highest run number at that time: a run that begins later is newer.
    newest: u64,
}

/// The repeated runs, each once, in the order in which they were last repeated: those of one pipeline say
/// nothing about another's.
type Repeats = Vec<RepeatedRun>;

/// Parses the file's bytes.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Repeats, LakeError> {
    match sealed::parse(path, bytes) {
        // An earlier version of the program kept the last one alone.
        Err(LakeError::Json { .. }) => sealed::parse(path, bytes).map(|only| vec![only]),
        parsed => parsed,
    }
}

/// Orders runs, the newest last: by number, except for repeated ones.
fn order(numbers: &[u64], repeats: &[RepeatedRun]) -> Vec<u64> {
    let mut ordered: Vec<((u64, usize), u64)> = numbers
        .iter()
        .map(|&number| {
            // Runs that began later are newer.
            let last = repeats.iter().rposition(|again| again.run == number);
            let place = last.and_then(|place| Some((repeats.get(place)?.newest, place + 1)));
            (place.unwrap_or((number, 0)), number)
        })
        .collect();
    ordered.sort_unstable();
    ordered.into_iter().map(|(_, number)| number).collect()
}

impl Register {
    /// Returns the number of the newest finished run with exactly these units, and, unless it
    /// already counts as the newest of all, the repetition to keep so that it does.
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

    /// Returns the repetition to keep so that the newest finished run of a pipeline, which a later one has just
    /// found unchanged, counts as the newest of all, unless it does.
    pub(crate) fn repeated_of(&self, pipeline: &str) -> Result<Option<RepeatedRun>, LakeError> {
        let ordered = self.ordered()?;
        let is_of_it =
            |run: &Run| run.record.pipeline == pipeline && run.record.status == RunStatus::Finished;
        // A damaged record of one run hides no other.
        let mut newest_first = ordered.iter().rev();
        let run = newest_first.find(|number| self.read(**number).is_ok_and(|run| is_of_it(&run)));
        let newest = ordered.iter().max();
        Ok(match (run, newest) {
            (Some(&run), Some(&newest)) if ordered.last() != Some(&run) => {
                Some(RepeatedRun { run, newest })
            }
            _ => None,
        })
    }

    /// Keeps a repetition.
    pub(crate) fn keep_repeated(&self, again: RepeatedRun, locks: &Locks) -> Result<(), LakeError> {
        let _turn = locks.lock_numbering()?;
        let folder = self.folder();
        let path = folder.repeated_run();
        // A list that is lost or damaged falls back to the order of numbers.
        let mut repeats = self.repeats().unwrap_or_default();
        repeats.retain(|earlier| earlier.run != again.run);
        repeats.push(again);
        replicas::write(folder, &path, &sealed::seal(&path, &repeats)?)
    }

    fn repeats(&self) -> Result<Repeats, LakeError> {
        let folder = self.folder();
        Ok(replicas::read(folder, &folder.repeated_run(), parse)?.unwrap_or_default())
    }

    /// Numbers of all runs, the newest last: in order, except for repeated ones.
    pub(crate) fn ordered(&self) -> Result<Vec<u64>, LakeError> {
        Ok(order(&self.numbers()?, &self.repeats()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_repetition_counts_and_later_runs_are_newer() {
        for (repeats, expected) in [
            (&[][..], [1, 2, 3]),
            (&[(1, 3)], [2, 3, 1]),
            (&[(2, 3), (1, 3)], [3, 2, 1]),
            (&[(1, 3), (3, 3)], [2, 1, 3]),
            (&[(1, 2)], [2, 1, 3]),
            (&[(9, 3), (2, 3)], [1, 3, 2]),
        ] {
            let again = |&(run, newest)| RepeatedRun { run, newest };
            let repeats: Vec<RepeatedRun> = repeats.iter().map(again).collect();
            assert_eq!(order(&[1, 2, 3], &repeats), expected, "{repeats:?}");
        }
    }

    #[test]
    fn the_single_repetition_of_an_earlier_version_is_read() {
        let path = Path::new("again.json");
        let only = RepeatedRun { run: 1, newest: 3 };
        let bytes = sealed::seal(path, &only).unwrap();
        assert_eq!(parse(path, &bytes).unwrap(), [only]);
    }
}
