//! Ctrl-C: cancels a robot's motion, drops units in flight, keeps stored results, and exits with
//! code 130.

use std::{process, sync::Arc, thread};

use lake::Lake;
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    iterator::Signals,
};

use stage_dispatch::{Cancellation, MotionInFlight};

use crate::{batch, commands::worker, label::Label, outcome::CommandError, report};

/// Exit code of a program that was interrupted.
pub(crate) const INTERRUPTED: u8 = 130;

/// Drops the units in flight when the program is interrupted.
pub(crate) fn drop_on_signal(lake: &Arc<Lake>) -> Result<(), CommandError> {
    let mut signals =
        Signals::new([SIGINT, SIGTERM]).map_err(|err| CommandError::failed(err, None))?;
    let lake = Arc::clone(lake);
    thread::spawn(move || {
        let mut signals = signals.forever();
        if signals.next().is_some() {
            thread::spawn(move || stop(&lake));
        }
        // A second signal ends the program at once.
        if signals.next().is_some() {
            for motion in stage_dispatch::stop_sending() {
                report::line(
                    Label::Stop,
                    format!(
                        "{}: left without the cell's answer, the robot may still move",
                        name(&motion)
                    ),
                );
            }
            process::exit(i32::from(INTERRUPTED));
        }
    });
    Ok(())
}

/// Cancels motions, drops the units in flight, reports both, and ends the program.
pub(crate) fn stop(lake: &Lake) -> ! {
    for array in batch::cancel_all() {
        report::line(Label::Stop, format!("array {array}: canceled"));
    }
    // First, so that nothing is written any more into what is dropped below.
    stage_program::stop_all();
    let motions = stage_dispatch::stop_sending();
    thread::scope(|scope| {
        for motion in &motions {
            scope.spawn(|| cancel(motion));
        }
    });
    let (_nothing_is_kept_now, n_dropped) = lake.abort();
    worker::leave_scratch(lake);
    let dropped = match n_dropped {
        0 => String::new(),
        1 => "the unit in the making is dropped, ".to_owned(),
        n => format!("the {n} units in the making are dropped, "),
    };
    report::line(
        Label::Interrupted,
        format!("{dropped}everything made before is kept; the same command goes on from there"),
    );
    process::exit(i32::from(INTERRUPTED));
}

/// Cancels a motion, and reports whether the robot has stopped.
fn cancel(motion: &MotionInFlight) {
    let name = name(motion);
    report::line(
        Label::Stop,
        format!(
            "{name}: canceled, waiting up to {} for the cell; Ctrl-C again does not wait",
            report::duration(motion.answer_timeout().as_secs_f64())
        ),
    );
    let (end, hint) = match motion.cancel() {
        Cancellation::Stopped => (
            "the robot stands".to_owned(),
            "look at the robot; the same command counts this motion as stopped and goes on with the next, \
             with `--set dispatch.resume_stopped=true` it sends this one again",
        ),
        Cancellation::Over => (
            "it was over before it could be canceled".to_owned(),
            "the same command goes on with the next motion",
        ),
        Cancellation::Unknown(why) => (
            format!("the robot may still move: {why}"),
            "look at the robot; the same command asks its cell for the outcome of this motion \
             before it sends another",
        ),
    };
    report::line(
        Label::Stop,
        format!("{name}: {end} (goal {})\nhint: {hint}", motion.goal_id()),
    );
}

fn name(motion: &MotionInFlight) -> String {
    format!(
        "motion `{}` at cell `{}`",
        motion.candidate_id(),
        motion.cell()
    )
}
