//! `pipeline export`

mod folder;
mod gather;
mod motion;
mod recorded;
mod rerun;

use std::path::PathBuf;

use dataflow::Diagnostic;
use formats::{Export, FormatError, GraspTimes};

use self::{folder::Folder, gather::GatheredMotions, motion::motion};
use crate::{
    arguments::{DexgraspbenchArgs, ExportArgs, ExportFormat, GlbArgs, LerobotArgs, MotionsArgs},
    command_line::Program,
    commands::lookup,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Writes motions as files for other programs.
pub(crate) fn export(program: &Program, args: &ExportArgs) -> Result<CommandOutcome, CommandError> {
    match &args.format {
        ExportFormat::Glb(args) => glb(program, args),
        ExportFormat::Lerobot(args) => lerobot(program, args),
        ExportFormat::Dexgraspbench(args) => dexgraspbench(program, args),
        ExportFormat::Csv(args) => csv(program, args),
    }
}

fn glb(program: &Program, args: &GlbArgs) -> Result<CommandOutcome, CommandError> {
    let lake = program.open_lake()?;
    let run = lookup::run(&lake, args.run.as_deref())?;
    let motion = motion(program, &lake, &run, args)?;
    let bytes = motion
        .to_glb(&args.name, usize::MAX)
        .map_err(CommandError::with_hint(Diagnostic::hint))?;
    let path = args.out.clone();
    let path = path.unwrap_or_else(|| PathBuf::from(format!("{}.glb", args.name)));
    lake::write_atomic(&path, &bytes)?;
    report::data(format!("{}\n", path.display()).as_bytes())?;
    Ok(CommandOutcome::Done)
}

fn lerobot(program: &Program, args: &LerobotArgs) -> Result<CommandOutcome, CommandError> {
    let folder = Folder::new(&args.motions.out)?;
    let gathered = GatheredMotions::executed(program, &args.motions)?;
    let export = formats::to_lerobot(&gathered.episodes, args.fps, &gathered.hand);
    finish(program, &args.motions, folder, &gathered, export)
}

fn csv(program: &Program, args: &MotionsArgs) -> Result<CommandOutcome, CommandError> {
    let folder = Folder::new(&args.out)?;
    let gathered = GatheredMotions::executed(program, args)?;
    let export = formats::to_csv(&gathered.episodes);
    finish(program, args, folder, &gathered, export)
}

fn dexgraspbench(
    program: &Program,
    args: &DexgraspbenchArgs,
) -> Result<CommandOutcome, CommandError> {
    let folder = Folder::new(&args.motions.out)?;
    let gathered = GatheredMotions::planned(program, &args.motions)?;
    let objects = gathered.objects(program)?;
    let times = GraspTimes {
        pregrasp: args.pregrasp_at,
        grasp: args.grasp_at,
    };
    let beside = || folder.path().join("objects").display().to_string();
    let objects_at = args.objects_at.clone().unwrap_or_else(beside);
    let (episodes, hand) = (&gathered.episodes, &gathered.hand);
    let export = formats::to_dexgraspbench(episodes, &objects, times, &objects_at, hand);
    finish(program, &args.motions, folder, &gathered, export)
}

/// Writes an export, and says what is in it and what is not.
fn finish(
    program: &Program,
    args: &MotionsArgs,
    folder: Folder,
    gathered: &GatheredMotions,
    export: Result<Export, FormatError>,
) -> Result<CommandOutcome, CommandError> {
    let export = export.map_err(CommandError::with_hint(FormatError::hint))?;
    folder.write(&export.files)?;
    for fact in gathered.left_out.iter().chain(&export.lost) {
        program.say(Label::Lost, fact);
    }
    let n = gathered.episodes.len();
    program.say(Label::Done, format!("{n} motions of `{}`", args.artifact));
    report::data(format!("{}\n", args.out.display()).as_bytes())?;
    Ok(CommandOutcome::Done)
}
