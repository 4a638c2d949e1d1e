//! Ctrl-C: units in flight are dropped, what is kept stays, and the exit code is 130.

use std::{process, sync::Arc, thread};

use lake::Lake;
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    iterator::Signals,
};

use crate::{outcome::Trouble, report};

/// Exit code of a program that was interrupted.
pub(crate) const INTERRUPTED: u8 = 130;

/// Drops what is being made in the lake when somebody stops the program.
pub(crate) fn drop_on_signal(lake: &Arc<Lake>) -> Result<(), Trouble> {
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(|err| Trouble::failed(err, None))?;
    let lake = Arc::clone(lake);
    thread::spawn(move || {
        let mut signals = signals.forever();
        if signals.next().is_some() {
            thread::spawn(move || stop(&lake));
        }
        // Who asks twice does not want to wait.
        if signals.next().is_some() {
            process::exit(i32::from(INTERRUPTED));
        }
    });
    Ok(())
}

/// Drops what is being made in the lake, says so, and ends the program.
pub(crate) fn stop(lake: &Lake) -> ! {
    let (_nothing_is_kept_now, n_dropped) = lake.abandon();
    let dropped = match n_dropped {
        0 => String::new(),
        1 => "the unit in the making is dropped, ".to_owned(),
        n => format!("the {n} units in the making are dropped, "),
    };
    report::line(&format!(
        "interrupted: {dropped}everything made before is kept; the same command goes on from there"
    ));
    process::exit(i32::from(INTERRUPTED));
}
