//! The program `pipeline` within the interpreter's process.

use std::{ffi::OsString, path::PathBuf};

use pyo3::prelude::*;

/// Executes a command line, the program's name first, and returns its exit code: 0 done, 1 failed, 2 wrong command
/// line or pipeline file, 3 done with skipped items, 130 interrupted. `executable` starts the program as a process of
/// its own.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, executable: PathBuf, words: Vec<OsString>) -> u8 {
    py.detach(|| pipeline::command_line_of(executable, words, &pipeline::kinds()))
}
