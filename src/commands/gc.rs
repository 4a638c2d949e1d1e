//! `pipeline gc`

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use dataflow::{Digest, Pipeline, reachable_fingerprints};
use lake::{GcMode, GcReport, Lake};

use crate::{
    arguments::{GcArgs, ValueArgs},
    command_line::Program,
    commands::pipeline_file,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Removes artifacts that no kept run and no pipeline file refers to.
pub(crate) fn gc(program: &Program, args: &GcArgs) -> Result<CommandOutcome, CommandError> {
    let collecting = if args.dry_run {
        GcMode::Count
    } else {
        GcMode::Remove
    };
    let collected = if args.depot {
        let lake = program.open_shared_lake()?;
        lake.collect_depot(usize::from(args.keep), collecting)?
    } else {
        of_lake(program, args, collecting)?
    };
    report::answer(args.format, &collected, |it| listed(it, collecting))?;
    let words = summary(&collected);
    match collecting {
        GcMode::Remove => program.say(Label::Done, format!("removed {words}")),
        GcMode::Count => {
            program.say(
                Label::Note,
                format!("would remove {words}; nothing is removed"),
            );
        }
    }
    Ok(CommandOutcome::Done)
}

fn of_lake(program: &Program, args: &GcArgs, collecting: GcMode) -> Result<GcReport, CommandError> {
    let lake = Lake::open(&program.lake);
    lake.check_exists()?;
    let mut kept: Vec<Digest> = Vec::new();
    for pipeline in pipelines(program, args, &lake)? {
        match reachable_fingerprints(&pipeline, &lake) {
            Ok(units) => kept.extend(units),
            // A missing dataset references nothing; the artifacts of its runs stay.
            Err(err) => note(program, &pipeline.origin.file, &err.to_string()),
        }
    }
    Ok(lake.collect(&kept, usize::from(args.keep), collecting)?)
}

/// The pipeline files to keep: the named ones, or the existing ones of the lake's runs.
fn pipelines(program: &Program, args: &GcArgs, lake: &Lake) -> Result<Vec<Pipeline>, CommandError> {
    let values = ValueArgs::default();
    if !args.files.is_empty() {
        let files = args.files.iter();
        return files
            .map(|file| pipeline_file::read_with(program.kinds, file, &values))
            .collect();
    }
    let mut files: BTreeSet<PathBuf> = BTreeSet::new();
    for number in lake.runs()? {
        // A damaged record of a run names no file.
        if let Ok(run) = lake.run_without_units(number) {
            files.insert(run.folder.join(run.record.origin.file));
        }
    }
    let (there, gone): (Vec<_>, Vec<_>) = files.iter().partition(|file| file.is_file());
    for file in gone {
        note(program, file, "it is not there any more");
    }
    there
        .into_iter()
        .map(|file| pipeline_file::read_with(program.kinds, file, &values))
        .collect()
}

/// Reports a pipeline file that cannot be read, so that only its runs' artifacts are kept.
fn note(program: &Program, file: &Path, why: &str) {
    program.say(
        Label::Note,
        format!("of `{}` only the newest runs count: {why}", file.display()),
    );
}

fn listed(collected: &GcReport, collecting: GcMode) -> String {
    let word = match collecting {
        GcMode::Remove => "gone",
        GcMode::Count => "goes",
    };
    let rows: Vec<Vec<String>> = collected
        .units
        .iter()
        .map(|(name, units)| {
            let n_units = match units.n_units {
                1 => "1 unit".to_owned(),
                n => format!("{n} units"),
            };
            vec![
                word.to_owned(),
                name.clone(),
                n_units,
                report::bytes(units.n_bytes),
            ]
        })
        .collect();
    report::columns(&rows, &[2, 3])
}

fn summary(collected: &GcReport) -> String {
    let n_units: usize = collected.units.values().map(|units| units.n_units).sum();
    format!(
        "{n_units} units, {} files with {}, {} leftovers of dead processes; {} units stay",
        collected.n_blobs,
        report::bytes(collected.n_bytes),
        collected.n_leftovers,
        collected.n_kept
    )
}
