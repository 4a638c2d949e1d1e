//! The run and the artifact that a command refers to.

use std::path::Path;

use dataflow::{Artifact, NodeName, RecordOutcome, UnitRef, did_you_mean};
use lake::{Lake, LakeError, Run};

use crate::outcome::CommandError;

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
