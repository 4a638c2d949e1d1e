//! Other programs' figures, from scripts in Python on one thread.

use std::{
    env,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

/// Starts a script below `tests/benches` in the Python that `PIPELINE_PYTHON` names, with pipes to
/// and from it; an error says why it cannot be.
pub(crate) fn start(script: &str, errors: Stdio) -> Result<Child, String> {
    let python = name();
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/benches")
        .join(script);
    Command::new(&python)
        .arg(path)
        .env("OMP_NUM_THREADS", "1")
        .env("OPENBLAS_NUM_THREADS", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()
        .map_err(|err| format!("cannot start `{}`: {err}", python.display()))
}

/// Returns the Python that runs scripts.
pub(crate) fn name() -> PathBuf {
    env::var_os("PIPELINE_PYTHON").map_or_else(|| "python3".into(), PathBuf::from)
}
