//! `pipeline calibrate`

mod answer;

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use calibration::{Calibration, CalibrationError, MAX_FILE_BYTES, Measurements};
use dataflow::missing;

use self::answer::Answer;
use crate::{
    arguments::{CalibrateArgs, Format},
    command_line::Program,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Fewest measurements that are checked against each other.
const CHECKED_N: usize = 4;

/// Finds a camera's pose relative to the robot, and fails if the measurements disagree.
pub(crate) fn calibrate(
    program: &Program,
    args: &CalibrateArgs,
) -> Result<CommandOutcome, CommandError> {
    let shown = args.file.display();
    let bytes = read(&args.file).map_err(|err| {
        let hint = format!("give a file of measurements; {}", missing(&args.file));
        let context = format!("cannot read `{shown}`");
        CommandError::failed(anyhow::Error::from(err).context(context), Some(hint))
    })?;
    let found = Measurements::parse(&bytes).and_then(|measurements| measurements.calibrate());
    let found = found.map_err(|err: CalibrationError| {
        let hint = err.hint();
        let context = format!("`{shown}` gives no calibration");
        CommandError::failed(anyhow::Error::from(err).context(context), hint)
    })?;
    let answer = Answer::of(&found);
    report::answer(args.format, &answer, Answer::text)?;
    warn(program, &found);
    let rms_mm = answer.residual.rms_mm;
    // NaN is no residual to accept.
    if rms_mm.is_nan() || rms_mm > args.max_error_mm {
        return Err(disagreement(&answer, args));
    }
    if answer.camera_r_w2c.is_some() && args.format == Format::Text {
        program.say(
            Label::Next,
            "`--format json` has `cam_R_w2c` and `cam_t_w2c`, as `scene_camera.json` of `views` takes them",
        );
    }
    Ok(CommandOutcome::Done)
}

/// Reads at most the maximum size of a file, plus one byte to detect a larger file.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let limit = u64::try_from(MAX_FILE_BYTES).unwrap_or(u64::MAX);
    File::open(path)?
        .take(limit.saturating_add(1))
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Says where measurements are not checked by others.
fn warn(program: &Program, found: &Calibration) {
    if found.held_out.len() < CHECKED_N {
        program.say(
            Label::Warn,
            "3 measurements are hardly checked against each other: take 4 or more",
        );
    } else if let Some(number) = found.indispensable() {
        program.say(
            Label::Warn,
            format!("without measurement {number} the others do not determine the pose: take more like it"),
        );
    }
}

fn disagreement(answer: &Answer, args: &CalibrateArgs) -> CommandError {
    let error = anyhow::anyhow!(
        "the measurements of `{}` disagree by {:.1} mm RMS, more than {} mm",
        args.file.display(),
        answer.residual.rms_mm,
        args.max_error_mm
    );
    let hint = answer.residual.largest.as_ref().map(|largest| {
        format!(
            "measurement {} has the largest residual, {:.1} mm: measure it again or leave it out; \
             `--max-error-mm` sets the limit",
            largest.number, largest.mm
        )
    });
    CommandError::failed(error, hint)
}
