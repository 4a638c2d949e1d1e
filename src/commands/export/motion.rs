//! The motion that is asked for: of a recording, of a candidate, or of a rollout that is executed again.

use dataflow::{Artifact, Diagnostic, NodeName, UnitRef};
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

use super::rerun;
use crate::{
    arguments::GlbArgs,
    command_line::Program,
    commands::{
        lookup,
        report::{Hand, hand},
    },
    outcome::CommandError,
};

/// Name of a trajectory's recording.
const TRAJECTORY: &str = "trajectory.mcap";

/// Returns the motion that is asked for.
pub(super) fn motion(
    program: &Program,
    lake: &Lake,
    run: &Run,
    args: &GlbArgs,
) -> Result<RecordedMotion, CommandError> {
    let (node, units) = lookup::units(run, &args.artifact)?;
    let hand = args.hand.as_deref().map(hand).transpose()?;
    match node.artifact.as_str() {
        Candidates::NAME => candidate(program, lake, run, &units, args, hand),
        Trajectory::NAME => {
            let unit = lookup::unit(&units, run.number, &args.artifact, &args.name)?;
            let artifact = lookup::artifact(lake, unit)?;
            let path = artifact.as_ref().and_then(|it| it.file(TRAJECTORY));
            let path = path.ok_or_else(|| without_recording(args))?;
            read(args, path, hand.as_ref())
        }
        Rollouts::NAME | Executions::NAME => {
            let (unit, artifact) = with_row(lake, &node, &units, args)?;
            if let Some(path) = artifact.file(&format!("{}.mcap", args.name)) {
                return read(args, path, hand.as_ref());
            }
            if node.artifact != *Rollouts::NAME {
                return Err(without_recording(args));
            }
            let folder = rerun::rollout(program, lake, run, unit, &args.name)?;
            let path = folder.path().join(format!("{}.mcap", args.name));
            if !path.is_file() {
                return Err(without_recording(args));
            }
            read(args, &path, hand.as_ref())
        }
        other => {
            let known = "candidates, trajectories, rollouts and executions have motions";
            Err(CommandError::usage(
                format!("`{other}` has no motions"),
                known,
            ))
        }
    }
}

fn read(
    args: &GlbArgs,
    path: &std::path::Path,
    hand: Option<&Hand>,
) -> Result<RecordedMotion, CommandError> {
    let contents = recording::read(path)?;
    let hand = hand.map(|(urdf, model)| (urdf.as_str(), model));
    RecordedMotion::read(&args.name, &contents, hand)
        .map_err(CommandError::with_hint(Diagnostic::hint))
}

/// The partition that has a row of the motion.
fn with_row<'a>(
    lake: &Lake,
    node: &NodeName,
    units: &[&'a UnitRef],
    args: &GlbArgs,
) -> Result<(&'a UnitRef, Artifact), CommandError> {
    for &unit in units {
        let Some(artifact) = lookup::artifact(lake, unit)? else {
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
            return Ok((unit, artifact));
        }
    }
    Err(unknown(args))
}

/// The motion of a candidate, as it was drawn.
fn candidate(
    program: &Program,
    lake: &Lake,
    run: &Run,
    units: &[&UnitRef],
    args: &GlbArgs,
    given: Option<Hand>,
) -> Result<RecordedMotion, CommandError> {
    for unit in units {
        let Some(of_object) = lookup::artifact(lake, unit)? else {
            continue;
        };
        let all: Candidates = table::read(&of_object)?;
        let found = all
            .candidates
            .iter()
            .find(|one| one.candidate_id == args.name);
        let Some(found) = found else { continue };
        let is_object = |other: &&UnitRef| {
            other.node.artifact == *Object::NAME && other.partition == unit.partition
        };
        let object = run.record.units.iter().find(is_object);
        let object = object
            .map(|unit| lookup::artifact(lake, unit))
            .transpose()?
            .flatten();
        let object = object.ok_or_else(|| {
            let message = format!(
                "the object `{}` is not in run {}",
                unit.partition, run.number
            );
            CommandError::usage(message, "export it from a run that has `objects`")
        })?;
        let object: Object = table::read(&object)?;
        let (_, model) = match given {
            Some(given) => given,
            None => hand(&rerun::hand_of(program, run)?)?,
        };
        return of_candidate(found, &all.joints, &object, &model)
            .map_err(CommandError::with_hint(Diagnostic::hint));
    }
    Err(unknown(args))
}

fn without_recording(args: &GlbArgs) -> CommandError {
    let message = format!(
        "`{}` of `{}` has no motion to show",
        args.name, args.artifact
    );
    let hint =
        "it was refused before anything moved, or its simulation diverged; export its candidate";
    CommandError::usage(message, hint)
}

fn unknown(args: &GlbArgs) -> CommandError {
    let table = args.artifact.rsplit('.').next().unwrap_or_default();
    let hint = format!("list them with `pipeline query \"select candidate_id from {table}\"`");
    let message = format!("`{}` has no motion `{}`", args.artifact, args.name);
    CommandError::usage(message, hint)
}
