//! A rollout that has no recording, executed again: equal arguments give an equal rollout.

use std::{collections::BTreeMap, path::PathBuf};

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Override, Pipeline, SourceFile, Stage, StageEntry, UnitRef,
};
use lake::{Lake, Run};
use schemas::{Table, candidates::Candidates, objects::Object};
use stage_screen::{Screen, record_alone};
use tempfile::TempDir;

use crate::{command_line::Program, commands::lookup, outcome::CommandError};

/// Returns the pipeline of a run, from its file as it is now.
fn pipeline(program: &Program, run: &Run) -> Result<Pipeline, CommandError> {
    let origin = &run.record.origin;
    let beside = run.folder.join(&origin.file);
    let file = if origin.file.is_file() {
        &origin.file
    } else {
        &beside
    };
    let text = std::fs::read_to_string(file).map_err(|err| {
        let hint = format!(
            "run {} was made from it; go to its folder, or give `--hand`",
            run.number
        );
        let message = format!("cannot read the pipeline file `{}`: {err}", file.display());
        CommandError::usage(message, hint)
    })?;
    let overrides = origin
        .overrides
        .iter()
        .map(|given| given.parse::<Override>());
    let overrides = overrides.collect::<Result<Vec<_>, _>>();
    let overrides = overrides.map_err(|err| CommandError::failed(err, None))?;
    let profile = origin.profile.as_deref();
    Ok(Pipeline::parse(
        file,
        &text,
        program.kinds,
        profile,
        &overrides,
    )?)
}

/// Returns the URDF of the hand that a run screened with.
pub(super) fn hand_of(program: &Program, run: &Run) -> Result<PathBuf, CommandError> {
    let pipeline = pipeline(program, run)?;
    let mut screens = pipeline
        .stages
        .iter()
        .filter_map(StageEntry::options::<Screen>);
    screens
        .next()
        .map(|screen| screen.hand.clone())
        .ok_or_else(|| {
            let hint = "name it, e.g. `--hand data/robots/allegro_right.urdf`";
            CommandError::usage(
                "the pipeline has no screen, whose hand would be taken",
                hint,
            )
        })
}

/// Executes a rollout of a unit again; its recording lies in the folder that is returned, if there is one.
pub(super) fn rollout(
    program: &Program,
    lake: &Lake,
    run: &Run,
    unit: &UnitRef,
    candidate: &str,
) -> Result<TempDir, CommandError> {
    let pipeline = pipeline(program, run)?;
    let changed = || {
        CommandError::usage(
            format!(
                "`{candidate}` was not recorded, and the pipeline file has changed since run {}",
                run.number
            ),
            "run it again, or record more with `recorded_per_object` of the screen",
        )
    };
    let stage = pipeline
        .find(unit.node.stage.as_str())
        .ok_or_else(changed)?;
    let recorded = run.record.stages.get(&unit.node.stage);
    let is_same = recorded
        .is_some_and(|recorded| recorded.config == stage.config() && recorded.kind == Screen::KIND);
    let options = stage
        .options::<Screen>()
        .filter(|_| is_same && pipeline.seed == run.record.seed);
    let options = options.ok_or_else(changed)?;
    let mut artifacts = BTreeMap::new();
    for input in [Candidates::NAME, Object::NAME] {
        let mut wires = stage.inputs.iter();
        let wire = wires.find(|(name, _)| name.as_str() == input);
        let (_, node) = wire.ok_or_else(changed)?;
        let mut units = run.record.units.iter();
        let read = units.find(|other| other.node == *node && other.partition == unit.partition);
        let read = read
            .map(|unit| lookup::artifact(lake, unit))
            .transpose()?
            .flatten();
        artifacts.insert(input.to_owned(), read.into_iter().collect());
    }
    let hand = SourceFile::named("hand", &options.hand);
    let inputs = Inputs::new(artifacts, vec![hand]);
    let folder = tempfile::tempdir().map_err(|err| CommandError::failed(err, None))?;
    let seed = stage.unit_seed(pipeline.seed, &unit.partition);
    let cx = Context::detached(&unit.partition, seed, folder.path());
    record_alone(options, &inputs, &cx, candidate)
        .map_err(CommandError::with_hint(BoxedDiagnostic::hint))?;
    Ok(folder)
}
