//! Tests of the tools that the benches share: a Python that fails is reported in its own words, and a limit that is
//! missed by more than noise sets the exit code.

#[path = "benches/limits.rs"]
mod limits;
#[path = "benches/python.rs"]
#[expect(dead_code, reason = "benches ask the user's Python, this test none")]
mod python;

use std::{
    fs::{self, File, Permissions},
    io::Write as _,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use limits::Limits;
use python::Script;
use tempfile::TempDir;

/// An interpreter that does what a shell script says, whatever it is given.
fn interpreter(folder: &TempDir, body: &str) -> PathBuf {
    let path = folder.path().join("python");
    let mut file = File::create(&path).unwrap();
    writeln!(file, "#!/bin/sh\n{body}").unwrap();
    drop(file);
    fs::set_permissions(&path, Permissions::from_mode(0o755)).unwrap();
    path
}

/// Starts a script with an interpreter and asks it twice; returns what it answered, or why it did not.
fn asked(python: &Path) -> Result<String, String> {
    let mut script = Script::start(python, "sampling/torch_ways.py", &[], 1)?;
    script.ask("one")?;
    script.ask("two")
}

#[test]
fn failing_python_is_an_error_with_place_and_hint() {
    let folder = tempfile::tempdir().unwrap();
    let install = "-m pip install -r tests/benches/requirements.txt`";
    let script = "`tests/benches/sampling/torch_ways.py`";
    for (body, expected) in [
        (
            "echo 'Traceback' >&2; echo \"ModuleNotFoundError: No module named 'torch'\" >&2; exit 1",
            &["has no module `torch`", script, install][..],
        ),
        (
            "echo \"ModuleNotFoundError: No module named 'six'\" >&2; echo >&2; exit 1",
            &["has no module `six`", script, install],
        ),
        (
            "exit 3",
            &[
                "ended without an answer",
                "exit status: 3",
                "said nothing",
                script,
                install,
            ],
        ),
        (
            "exit 0",
            &[
                "ended without an answer",
                "exit status: 0",
                "said nothing",
                script,
            ],
        ),
        (
            "echo 'RuntimeError: no memory' >&2; exit 1",
            &[
                "ended without an answer",
                "exit status: 1",
                "`RuntimeError: no memory`",
                script,
            ],
        ),
        (
            "kill -9 $$",
            &["ended without an answer", "signal: 9", script],
        ),
        // It breaks off in the middle.
        (
            "read line; echo first; exit 5",
            &["ended without an answer", "exit status: 5", script],
        ),
    ] {
        let python = interpreter(&folder, body);
        let said = asked(&python).unwrap_err();
        for part in expected {
            assert!(said.contains(part), "{body}: no `{part}` in `{said}`");
        }
        assert!(said.contains(&python.display().to_string()), "{said}");
    }
    let said = asked(&folder.path().join("none")).unwrap_err();
    for part in ["cannot start the Python `", "none`", "`PIPELINE_PYTHON`"] {
        assert!(said.contains(part), "no `{part}` in `{said}`");
    }
    let python = interpreter(&folder, "while read line; do echo \"heard $line\"; done");
    assert_eq!(asked(&python).unwrap(), "heard two");
}

#[test]
fn a_limit_that_is_missed_by_more_than_noise_fails_the_bench() {
    let code = |check: fn(&mut Limits)| {
        let mut limits = Limits::with_noise(0.1);
        limits.keep("one that is kept", 1.0, 1.0..);
        check(&mut limits);
        limits.end()
    };
    let kept: [fn(&mut Limits); 4] = [
        |limits| limits.keep("times", 1.81, 2.0..),
        |limits| limits.keep("times", 9.0, 2.0..),
        |limits| limits.keep("MB", 109.0, ..=100.0),
        |limits| limits.keep("changed", 0.0, ..=0.0),
    ];
    for check in kept {
        assert_eq!(code(check), ExitCode::SUCCESS);
    }
    let missed: [fn(&mut Limits); 5] = [
        |limits| limits.keep("times", 1.79, 2.0..),
        |limits| limits.keep("MB", 111.0, ..=100.0),
        |limits| limits.keep("changed", 1.0, ..=0.0),
        |limits| limits.keep("times", f64::NAN, 2.0..),
        |limits| limits.keep("MB", f64::NAN, ..=100.0),
    ];
    for check in missed {
        assert_eq!(code(check), ExitCode::FAILURE);
    }
}
