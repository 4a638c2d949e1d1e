//! Other programs' figures, from scripts in Python.

use std::{
    env,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

/// Starts a script below `tests/benches` on a number of threads in the Python that `PIPELINE_PYTHON`
/// names, with pipes to and from it; an error says why it cannot be.
pub(crate) fn start(
    script: &str,
    arguments: &[&str],
    threads: usize,
    errors: Stdio,
) -> Result<Child, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/benches")
        .join(script);
    Command::new(name())
        .arg(path)
        .args(arguments)
        .env("OMP_NUM_THREADS", threads.to_string())
        .env("OPENBLAS_NUM_THREADS", threads.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()
        .map_err(|err| format!("cannot start `{}`: {err}", name().display()))
}

/// Returns the Python that runs scripts.
pub(crate) fn name() -> PathBuf {
    env::var_os("PIPELINE_PYTHON").map_or_else(|| "python3".into(), PathBuf::from)
}
