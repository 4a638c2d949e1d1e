//! Artifacts for programs that hold this one as a library, by what they know of them.

use std::path::Path;

use dataflow::{Artifact, BoxedDiagnostic, RunStatus, UnitRef, did_you_mean};
use lake::{Lake, Run};

use super::lookup;
use crate::{library::Wanted, outcome::CommandError};

/// Reads artifacts of the lake in this folder, in the order of their partitions; they are not collected meanwhile.
pub(crate) fn read_artifacts<T>(
    lake: &Path,
    wanted: &Wanted<'_>,
    read: impl FnMut(&Artifact) -> Result<T, BoxedDiagnostic>,
) -> Result<Vec<T>, CommandError> {
    let lake = Lake::open(lake);
    lake.check_exists()?;
    let found = {
        let _kept = lake.block_collection();
        artifacts(&lake, wanted).and_then(|artifacts| {
            let read = artifacts.iter().map(read).collect::<Result<_, _>>();
            read.map_err(|err| {
                let hint = err.hint();
                CommandError::failed(err, hint)
            })
        })
    };
    lake.leave();
    found
}

/// Finds artifacts in their run: all that it has, or the one of the partition.
fn artifacts(lake: &Lake, wanted: &Wanted<'_>) -> Result<Vec<Artifact>, CommandError> {
    let run = run_with(lake, wanted)?;
    let units: Vec<&UnitRef> = run
        .record
        .units
        .iter()
        .filter(|unit| wanted.is(unit))
        .collect();
    let of_run = |what: &str| {
        let place = lake.root().display();
        format!("{what} in run {} of the lake `{place}`", run.number)
    };
    check_stages(wanted, &units, of_run)?;
    let Some(partition) = wanted.partition else {
        let kept = units.iter().map(|unit| lookup::artifact(lake, unit));
        return Ok(kept
            .collect::<Result<Vec<_>, _>>()?
            .into_iter()
            .flatten()
            .collect());
    };
    let partitions = || units.iter().map(|unit| unit.partition.as_str());
    let Some(unit) = units.iter().find(|unit| unit.partition == *partition) else {
        let message = format!("`{}` has no partition `{partition}`", wanted.artifact);
        let all = || format!("it has: {}", partitions().collect::<Vec<_>>().join(", "));
        let hint = did_you_mean(partition, partitions()).unwrap_or_else(all);
        return Err(CommandError::usage(of_run(&message), hint));
    };
    let kept = lookup::artifact(lake, unit)?.ok_or_else(|| {
        let message = format!("`{}` of `{partition}` is not kept", wanted.artifact);
        let hint = format!(
            "`pipeline inspect {} --skipped` says why it was skipped; what was collected is made by the next run",
            unit.node
        );
        CommandError::usage(of_run(&message), hint)
    })?;
    Ok(vec![kept])
}

/// Returns the run of the name, or the newest finished one that has what is wanted, or else the newest.
fn run_with(lake: &Lake, wanted: &Wanted<'_>) -> Result<Run, CommandError> {
    if wanted.run.is_none() {
        for number in lake.runs()?.into_iter().rev() {
            // A damaged record of one run does not hide others.
            let run = lake.run(number).ok();
            let run = run.filter(|run| {
                let mut units = run.record.units.iter();
                run.record.status == RunStatus::Finished && units.any(|unit| wanted.is(unit))
            });
            if let Some(run) = run {
                return Ok(run);
            }
        }
    }
    lookup::run(lake, wanted.run)
}

/// Checks that one stage made these units.
fn check_stages(
    wanted: &Wanted<'_>,
    units: &[&UnitRef],
    of_run: impl Fn(&str) -> String,
) -> Result<(), CommandError> {
    let mut stages: Vec<&str> = units.iter().map(|unit| unit.node.stage.as_str()).collect();
    stages.dedup();
    let (message, hint) = match stages.as_slice() {
        [_] => return Ok(()),
        [] => {
            let of_stage = wanted.stage.map(|stage| format!(" of the stage `{stage}`"));
            (
                format!(
                    "there are no `{}`{}",
                    wanted.artifact,
                    of_stage.unwrap_or_default()
                ),
                "`pipeline runs` lists the runs and what they made".to_owned(),
            )
        }
        several => (
            format!("several stages made `{}`", wanted.artifact),
            format!("name one: {}", several.join(", ")),
        ),
    };
    Err(CommandError::usage(of_run(&message), hint))
}

impl Wanted<'_> {
    /// Whether a unit is one of them, of whatever partition.
    fn is(&self, unit: &UnitRef) -> bool {
        unit.node.artifact == *self.artifact
            && self.stage.is_none_or(|stage| unit.node.stage == *stage)
    }
}
