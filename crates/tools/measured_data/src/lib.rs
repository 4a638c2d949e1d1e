//! Folders of measured data for tests and benches, named by environment variables.
//!
//! No such data is part of the project. A test that finds none prints why it skips, to stderr itself: the harness
//! hides what a passing test prints.
//!
//! ```
//! let Some(dataset) = measured_data::folder("dexycb-right") else { return };
//! assert!(dataset.is_dir());
//! ```
//!
//! Only tests and benches link this crate.

use std::{
    env,
    io::{self, Write},
    path::{Path, PathBuf},
};

/// The folder of recordings, meshes and robots.
const REAL_DATA: &str = "PIPELINE_REAL_DATA";

/// Returns a folder inside the one that `PIPELINE_REAL_DATA` names, or prints that there is none.
pub fn folder(name: &str) -> Option<PathBuf> {
    let found = env::var_os(REAL_DATA).map(|root| Path::new(&root).join(name));
    let found = found.filter(|folder| folder.is_dir());
    if found.is_none() {
        print_skipped(&format!("`{REAL_DATA}` holds no `{name}`"));
    }
    found
}

/// Returns the folder that an environment variable names, or prints that there is none.
pub fn named_by(variable: &str) -> Option<PathBuf> {
    let found = env::var_os(variable).map(PathBuf::from);
    if found.is_none() {
        print_skipped(&format!("`{variable}` is not set"));
    }
    found
}

/// Prints why a test skips.
pub fn print_skipped(reason: &str) {
    // Nothing is lost if stderr is closed: the test skips all the same.
    let _ = writeln!(
        io::stderr().lock(),
        "skipped: {reason}; see `tests/README.md`"
    );
}
