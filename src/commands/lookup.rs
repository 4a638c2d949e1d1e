//! The run and the artifact that a command refers to.

use std::path::Path;

use dataflow::{
    Artifact, BoxedDiagnostic, NodeName, PartitionKey, RecordOutcome, UnitRef, did_you_mean,
};
use lake::{Lake, LakeError, Run};

use crate::{library::Wanted, outcome::CommandError};

/// Returns the run of this name, or the newest one.
pub(crate) fn run(lake: &Lake, name: Option<&str>) -> Result<Run, CommandError> {
    if let Some(name) = name {
        return Ok(lake.run(lake.find_run(name)?)?);
    }
    lake.newest_run()?.ok_or_else(|| no_runs(lake))
}

/// Returns the error of a lake without runs.
pub(crate) fn no_runs(lake: &Lake) -> CommandError {
    CommandError::usage(
        format!("no run in the lake `{}`", lake.root().display()),
        format!("{}, or name another lake with `--lake DIR`", begin()),
    )
}

/// Returns the hint for a first run in this folder.
pub(crate) fn begin() -> &'static str {
    const FILE: &str = "pipelines/cgf.toml";
    if Path::new(FILE).is_file() {
        "make some with `pipeline run pipelines/cgf.toml`"
    } else {
        "`pipeline new NAME` makes a project to run"
    }
}

/// Returns a run, and whether its units are still in the lake; if not, the run is without them.
pub(crate) fn run_and_whether_kept(lake: &Lake, number: u64) -> Result<(Run, bool), CommandError> {
    match lake.run(number) {
        Err(LakeError::Lost { .. }) => Ok((lake.run_without_units(number)?, false)),
        run => Ok((run?, true)),
    }
}

/// Returns an output of a run by its name, and its units.
pub(crate) fn units<'a>(
    run: &'a Run,
    artifact: &str,
) -> Result<(NodeName, Vec<&'a UnitRef>), CommandError> {
    let units = &run.record.units;
    if let Some(node) = NodeName::parse(artifact) {
        let units: Vec<&UnitRef> = units.iter().filter(|unit| unit.node == node).collect();
        if !units.is_empty() {
            return Ok((node, units));
        }
    }
    let mut known: Vec<String> = units.iter().map(|unit| unit.node.to_string()).collect();
    known.dedup();
    let near = did_you_mean(artifact, known.iter().map(String::as_str));
    Err(CommandError::usage(
        format!("no artifact `{artifact}` in run {}", run.number),
        near.unwrap_or_else(|| format!("run {} has: {}", run.number, known.join(", "))),
    ))
}

/// Returns the unit of a partition among those of a run.
pub(crate) fn unit<'a>(
    units: &[&'a UnitRef],
    run: u64,
    artifact: &str,
    partition: &str,
) -> Result<&'a UnitRef, CommandError> {
    let found = units.iter().find(|unit| unit.partition == *partition);
    found.copied().ok_or_else(|| {
        let near = did_you_mean(partition, units.iter().map(|unit| unit.partition.as_str()));
        let all = || format!("list them with `pipeline inspect {artifact} --run {run}`");
        let message = format!("`{artifact}` has no partition `{partition}`");
        CommandError::usage(message, near.unwrap_or_else(all))
    })
}

/// The artifact of a unit; `None` if it was collected, skipped or filtered.
pub(crate) fn artifact(lake: &Lake, unit: &UnitRef) -> Result<Option<Artifact>, CommandError> {
    let outcome = lake.record(&unit.fingerprint)?.map(|record| record.outcome);
    let Some(RecordOutcome::Made { files, labels, .. }) = outcome else {
        return Ok(None);
    };
    let files = files.iter();
    Ok(Some(Artifact {
        key: unit.partition.clone(),
        labels,
        files: files
            .map(|(name, file)| Ok((name.to_string(), lake.fetched(file)?)))
            .collect::<Result<_, CommandError>>()?,
    }))
}

/// Reads an artifact of the lake in this folder; it is not collected meanwhile.
pub(crate) fn read_artifact<T>(
    lake: &Path,
    wanted: &Wanted<'_>,
    read: impl FnOnce(&Artifact) -> Result<T, BoxedDiagnostic>,
) -> Result<T, CommandError> {
    let lake = Lake::open(lake);
    lake.check_exists()?;
    let found = {
        let _kept = lake.block_collection();
        wanted_artifact(&lake, wanted).and_then(|artifact| {
            read(&artifact).map_err(|err| {
                let hint = err.hint();
                CommandError::failed(err, hint)
            })
        })
    };
    lake.leave();
    found
}

/// Finds an artifact in its run, or in the newest that has it.
fn wanted_artifact(lake: &Lake, wanted: &Wanted<'_>) -> Result<Artifact, CommandError> {
    let is_wanted = |unit: &&UnitRef| {
        unit.node.artifact == *wanted.artifact
            && wanted.stage.is_none_or(|stage| unit.node.stage == *stage)
    };
    let found = if wanted.run.is_some() {
        run(lake, wanted.run)?
    } else {
        let mut newest_first = lake.runs()?.into_iter().rev();
        let with_it = newest_first.find_map(|number| {
            let run = lake.run(number).ok()?;
            run.record
                .units
                .iter()
                .any(|unit| is_wanted(&unit))
                .then_some(run)
        });
        with_it.map_or_else(|| run(lake, None), Ok)?
    };
    let units: Vec<&UnitRef> = found.record.units.iter().filter(is_wanted).collect();
    let of_run = |what: String| {
        format!(
            "{what} in run {} of the lake `{}`",
            found.number,
            lake.root().display()
        )
    };
    let mut stages: Vec<&str> = units.iter().map(|unit| unit.node.stage.as_str()).collect();
    stages.dedup();
    match stages.as_slice() {
        [] => {
            let from = wanted
                .stage
                .map_or_else(String::new, |stage| format!(" of the stage `{stage}`"));
            let message = of_run(format!("there are no `{}`{from}", wanted.artifact));
            return Err(CommandError::usage(
                message,
                "`pipeline runs` lists the runs and what they made",
            ));
        }
        [_] => {}
        several => {
            let message = of_run(format!("several stages made `{}`", wanted.artifact));
            return Err(CommandError::usage(
                message,
                format!("name one: {}", several.join(", ")),
            ));
        }
    }
    let partitions = || units.iter().map(|unit| unit.partition.as_str());
    let is_named = |unit: &&&UnitRef| wanted.partition.is_none_or(|name| unit.partition == *name);
    let Some(unit) = units.iter().find(is_named) else {
        let name = wanted.partition.unwrap_or_default();
        let message = of_run(format!("`{}` has no partition `{name}`", wanted.artifact));
        let known = || format!("it has: {}", partitions().collect::<Vec<_>>().join(", "));
        return Err(CommandError::usage(
            message,
            did_you_mean(name, partitions()).unwrap_or_else(known),
        ));
    };
    artifact(lake, unit)?.ok_or_else(|| {
        let key: &PartitionKey = &unit.partition;
        let message = of_run(format!("`{}` of `{key}` was skipped, or collected since,", wanted.artifact));
        CommandError::usage(message, "`pipeline inspect` says why it was skipped; what was collected is made by the next run")
    })
}
