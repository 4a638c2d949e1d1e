//! `pipeline export`

use std::path::PathBuf;

use dataflow::{Artifact, Digest, NodeName, RecordOutcome, UnitRef};
use lake::{Lake, Run, recording, table};
use schemas::{
    Table,
    candidates::Candidates,
    executions::{Execution, Executions},
    objects::Object,
    rollouts::{Rollout, Rollouts},
    trajectories::Trajectory,
};
use stage_report::{RecordedMotion, of_candidate};

use crate::{
    arguments::{ExportArgs, ExportFormat, GlbArgs},
    command_line::Program,
    commands::{
        lookup,
        report::{Hand, failed, hand},
    },
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Writes a motion as a file for other programs.
pub(crate) fn export(program: &Program, args: &ExportArgs) -> Result<CommandOutcome, CommandError> {
    match &args.format {
        ExportFormat::Glb(args) => glb(program, args),
    }
}

fn glb(program: &Program, args: &GlbArgs) -> Result<CommandOutcome, CommandError> {
    let lake = Lake::open(&program.lake);
    let run = lookup::run(&lake, args.run.as_deref())?;
    let (node, units) = lookup::units(&run, &args.artifact)?;
    let hand = args.hand.as_deref().map(hand).transpose()?;
    let motion = match node.artifact.as_str() {
        Candidates::NAME => candidate(&lake, &run, &units, args, hand.as_ref())?,
        Trajectory::NAME => {
            let unit = lookup::unit(&units, run.number, &args.artifact, &args.name)?;
            let artifact = artifact(&lake, unit)?;
            recorded(artifact.as_ref(), "trajectory.mcap", args, hand.as_ref())?
        }
        Rollouts::NAME | Executions::NAME => {
            let artifact = with_row(&lake, &node, &units, args)?;
            recorded(
                artifact.as_ref(),
                &format!("{}.mcap", args.name),
                args,
                hand.as_ref(),
            )?
        }
        other => {
            let known = "candidates, trajectories, rollouts and executions have motions";
            return Err(CommandError::usage(
                format!("`{other}` has no motions"),
                known,
            ));
        }
    };
    let bytes = motion.to_glb(&args.name, usize::MAX).map_err(failed)?;
    let path = args.out.clone();
    let path = path.unwrap_or_else(|| PathBuf::from(format!("{}.glb", args.name)));
    lake::write_atomic(&path, &bytes)?;
    report::data(format!("{}\n", path.display()).as_bytes())?;
    Ok(CommandOutcome::Done)
}

/// The artifact of a unit; `None` if it was collected, skipped or filtered.
fn artifact(lake: &Lake, unit: &UnitRef) -> Result<Option<Artifact>, CommandError> {
    of_fingerprint(lake, unit, &unit.fingerprint)
}

fn of_fingerprint(
    lake: &Lake,
    unit: &UnitRef,
    fingerprint: &Digest,
) -> Result<Option<Artifact>, CommandError> {
    let outcome = lake.record(fingerprint)?.map(|record| record.outcome);
    let Some(RecordOutcome::Made { files, labels, .. }) = outcome else {
        return Ok(None);
    };
    Ok(Some(Artifact {
        key: unit.partition.clone(),
        labels,
        files: files
            .iter()
            .map(|(name, file)| (name.clone(), lake.file(file)))
            .collect(),
    }))
}

/// The motion of a recording.
fn recorded(
    artifact: Option<&Artifact>,
    file: &str,
    args: &GlbArgs,
    hand: Option<&Hand>,
) -> Result<RecordedMotion, CommandError> {
    let path = artifact.and_then(|artifact| artifact.file(file));
    let path = path.ok_or_else(|| {
        let hint = "record more with `recorded_per_object` and `recorded_failures_per_object` of the screen, or \
                    export its candidate";
        CommandError::usage(format!("`{}` of `{}` has no recording", args.name, args.artifact), hint)
    })?;
    let contents = recording::read(path)?;
    let hand = hand.map(|(urdf, model)| (urdf.as_str(), model));
    RecordedMotion::read(&args.name, &contents, hand).map_err(failed)
}

/// The partition that has a row of the motion.
fn with_row(
    lake: &Lake,
    node: &NodeName,
    units: &[&UnitRef],
    args: &GlbArgs,
) -> Result<Option<Artifact>, CommandError> {
    for unit in units {
        let Some(artifact) = artifact(lake, unit)? else {
            continue;
        };
        let has_it = if node.artifact == *Rollouts::NAME {
            let rows: Rollouts = table::read(&artifact)?;
            rows.iter()
                .any(|row: &Rollout| row.candidate_id == args.name)
        } else {
            let rows: Executions = table::read(&artifact)?;
            rows.iter()
                .any(|row: &Execution| row.candidate_id == args.name)
        };
        if has_it {
            return Ok(Some(artifact));
        }
    }
    Err(unknown(args))
}

fn unknown(args: &GlbArgs) -> CommandError {
    let hint = format!(
        "list them with `pipeline query \"select candidate_id from {}\"`",
        args.artifact.rsplit('.').next().unwrap_or_default()
    );
    CommandError::usage(
        format!("`{}` has no motion `{}`", args.artifact, args.name),
        hint,
    )
}

/// The motion of a candidate, as it was drawn.
fn candidate(
    lake: &Lake,
    run: &Run,
    units: &[&UnitRef],
    args: &GlbArgs,
    hand: Option<&Hand>,
) -> Result<RecordedMotion, CommandError> {
    let (_, model) = hand.ok_or_else(|| {
        let hint = "name it, e.g. `--hand data/robots/allegro_right.urdf`";
        CommandError::usage("a candidate needs its hand's URDF", hint)
    })?;
    for unit in units {
        let Some(artifact) = artifact(lake, unit)? else {
            continue;
        };
        let all: Candidates = table::read(&artifact)?;
        let found = all
            .candidates
            .iter()
            .find(|one| one.candidate_id == args.name);
        let Some(found) = found else { continue };
        let objects = run.record.units.iter().filter(|other| {
            other.node.artifact == *Object::NAME && other.partition == unit.partition
        });
        for object in objects {
            if let Some(artifact) = of_fingerprint(lake, object, &object.fingerprint)? {
                let object: Object = table::read(&artifact)?;
                return of_candidate(found, &all.joints, &object, model).map_err(failed);
            }
        }
        return Err(CommandError::usage(
            format!(
                "the object `{}` is not in run {}",
                unit.partition, run.number
            ),
            "export it from a run that has `objects`",
        ));
    }
    Err(unknown(args))
}
