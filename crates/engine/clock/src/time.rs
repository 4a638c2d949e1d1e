//! The time, and the names of processes.

use std::{
    hash::{BuildHasher, RandomState},
    thread,
    time::{Duration, Instant, SystemTime},
};

use crate::simulated::here;

/// Returns the time of a clock that never goes back.
pub fn now() -> Instant {
    here().map_or_else(Instant::now, |here| here.now())
}

/// Returns the time since a moment; zero if that is to come.
pub fn since(moment: Instant) -> Duration {
    now().saturating_duration_since(moment)
}

/// Returns the time of day.
#[expect(
    clippy::disallowed_methods,
    reason = "only `lake` calls this, which notes when things were made"
)]
pub fn wall() -> SystemTime {
    here().map_or_else(SystemTime::now, |here| here.wall())
}

/// Blocks this thread for some time.
pub fn sleep(time: Duration) {
    match here() {
        Some(here) => here.sleep(time),
        None => thread::sleep(time),
    }
}

/// Returns a number that differs from call to call and from process to process; that of a simulation follows from its
/// seed.
pub fn random() -> u64 {
    here().map_or_else(|| RandomState::new().hash_one(0), |here| here.random())
}

/// Returns the name of this process if it is a simulated one: `NUMBER-START-MACHINE`, with its start in nanoseconds.
pub fn process() -> Option<String> {
    here().map(|here| here.process())
}

/// Returns the name of the machine of a simulated process.
pub fn machine() -> Option<String> {
    let process = process()?;
    process.splitn(3, '-').nth(2).map(str::to_owned)
}
