//! The only clock of the project, and the machine's name: they are provenance, never part of an
//! artifact.

use std::{
    fs,
    sync::OnceLock,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

/// Returns the time of day.
pub(crate) fn now() -> SystemTime {
    ::clock::wall()
}

/// Returns the time until a moment, in seconds since 1970; `None` if it is over.
#[must_use]
pub fn time_until(since_1970_s: u64) -> Option<Duration> {
    let moment = UNIX_EPOCH.checked_add(Duration::from_secs(since_1970_s))?;
    moment.duration_since(now()).ok()
}

/// Nanoseconds since 1970.
pub(crate) fn nanoseconds(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

/// The name by which records call the running program, if it is not that of the process's file.
static PROGRAM: OnceLock<String> = OnceLock::new();

/// Says by which name records call the running program: within another process its file is that one's. The first name
/// counts.
pub fn name_program(name: &str) {
    PROGRAM.get_or_init(|| name.to_owned());
}

/// The running program's name, and the version of the crates it is built with.
pub(crate) fn program() -> String {
    let of_file = || {
        let path = std::env::current_exe().unwrap_or_default();
        let name = path.file_stem().map(|stem| stem.to_string_lossy());
        name.unwrap_or("pipeline".into()).into_owned()
    };
    let name = PROGRAM.get().cloned().unwrap_or_else(of_file);
    format!("{name} {}", env!("CARGO_PKG_VERSION"))
}

/// The machine's name.
#[must_use]
pub fn host() -> String {
    if let Some(machine) = ::clock::machine() {
        return machine;
    }
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_owned()
}
