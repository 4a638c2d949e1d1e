//! How this program was started: as a process of its own, or by another program that holds it as a library.

use std::{
    env,
    ffi::OsString,
    io,
    path::PathBuf,
    sync::{
        OnceLock,
        atomic::{AtomicBool, Ordering},
    },
};

/// The program's file and the words of its command line, its name first.
pub(crate) struct Invocation {
    pub(crate) executable: PathBuf,
    pub(crate) words: Vec<OsString>,
}

/// What the program that holds this one says; unset in a process of its own.
static TOLD: OnceLock<Invocation> = OnceLock::new();

/// Whether a command line is executed, rather than single functions called.
static IS_PROGRAM: AtomicBool = AtomicBool::new(false);

/// Says that a command line is executed.
pub(crate) fn set_program() {
    IS_PROGRAM.store(true, Ordering::Relaxed);
}

/// Whether a command line is executed: only then may the process be ended.
pub(crate) fn is_program() -> bool {
    IS_PROGRAM.load(Ordering::Relaxed)
}

/// Says how the program was started; the first one to do so is believed.
pub(crate) fn set(invocation: Invocation) {
    TOLD.get_or_init(|| invocation);
}

/// Returns the file that starts this program again.
pub(crate) fn executable() -> io::Result<PathBuf> {
    TOLD.get()
        .map_or_else(env::current_exe, |told| Ok(told.executable.clone()))
}

/// Returns the words of the command line, the program's name first.
pub(crate) fn words() -> Vec<OsString> {
    TOLD.get()
        .map_or_else(|| env::args_os().collect(), |told| told.words.clone())
}
