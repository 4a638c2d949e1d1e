//! Test hooks of these stages, set by environment variables; real stages need none.

use std::{env, fs::File, io::Write, path::Path, process, thread, time::Duration};

use dataflow::{Context, Output, Stage};

use super::OwnError;

/// Interval between checks whether a held unit may continue.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// Notes that a unit is being made, then holds it for as long as a test asks for.
pub(crate) fn started<O: Output>(cx: &Context) -> Result<(), OwnError> {
    note::<O>(O::Stage::KIND, cx)?;
    take_time();
    hold(cx.partition().as_str());
    Ok(())
}

/// Appends `kind output partition process seed` to the file `OWN_STAGES_LOG` in one piece. The seed
/// tells stages of one kind apart.
pub(crate) fn note<O: Output>(kind: &str, cx: &Context) -> Result<(), OwnError> {
    let Some(path) = env::var_os("OWN_STAGES_LOG") else {
        return Ok(());
    };
    let (output, partition, seed) = (O::ARTIFACT, cx.partition(), cx.seed());
    let line = format!("{kind} {output} {partition} {} {seed}\n", process::id());
    let log = File::options().append(true).create(true).open(&path);
    log.and_then(|mut log| log.write_all(line.as_bytes()))
        .map_err(OwnError::at(Path::new(&path)))
}

/// Takes the milliseconds in `OWN_STAGES_TAKES`.
fn take_time() {
    let takes = env::var("OWN_STAGES_TAKES").ok();
    if let Some(takes_ms) = takes.and_then(|takes| takes.parse().ok()) {
        thread::sleep(Duration::from_millis(takes_ms));
    }
}

/// Waits until the folder `OWN_STAGES_GATE` holds a file `NAME.go`, or is gone.
pub(crate) fn hold(name: &str) {
    let Some(gate) = env::var_os("OWN_STAGES_GATE") else {
        return;
    };
    let gate = Path::new(&gate);
    let go = gate.join(format!("{name}.go"));
    while gate.exists() && !go.exists() {
        thread::park_timeout(LOOK_EVERY);
    }
}

/// Fails if `OWN_STAGES_FAIL` names this moment.
pub(crate) fn fail(moment: &str) -> Result<(), OwnError> {
    match env::var("OWN_STAGES_FAIL") {
        Ok(named) if named == moment => Err(OwnError::Asked(named)),
        _ => Ok(()),
    }
}
