//! `pipeline export`

mod motion;
mod rerun;

use std::path::PathBuf;

use self::motion::motion;
use crate::{
    arguments::{ExportArgs, ExportFormat, GlbArgs},
    command_line::Program,
    commands::{lookup, report::failed},
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
    let lake = program.open_lake()?;
    let run = lookup::run(&lake, args.run.as_deref())?;
    let motion = motion(program, &lake, &run, args)?;
    let bytes = motion.to_glb(&args.name, usize::MAX).map_err(failed)?;
    let path = args.out.clone();
    let path = path.unwrap_or_else(|| PathBuf::from(format!("{}.glb", args.name)));
    lake::write_atomic(&path, &bytes)?;
    report::data(format!("{}\n", path.display()).as_bytes())?;
    Ok(CommandOutcome::Done)
}
