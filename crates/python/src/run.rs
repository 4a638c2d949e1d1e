//! Runs of pipeline files, each a process of its own.

use std::{
    ffi::OsString,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use rustix::process::{Pid, Signal, kill_process};

use crate::{
    error::{raised, wrong},
    threads::signals,
};

/// Starts the program of the module, whatever lies in the folder in which it runs.
const PROGRAM: &str = "import sys; sys.path = [p for p in sys.path if p]; \
                       from pipeline.__main__ import main; sys.exit(main())";
/// Time after which a run looks for signals.
const PATIENCE: Duration = Duration::from_millis(50);
/// Exit code of a run of which items were skipped.
const SKIPPED: i32 = 3;

/// What is to be run.
pub(crate) struct Given<'a, 'py> {
    /// The pipeline file.
    pub(crate) file: &'a Path,
    /// Values that replace the file's, by their dotted keys.
    pub(crate) set: Option<&'a Bound<'py, PyDict>>,
    /// One of its profiles.
    pub(crate) profile: Option<&'a str>,
    /// The last stage to run.
    pub(crate) until: Option<&'a str>,
    /// Number of worker threads.
    pub(crate) jobs: Option<u16>,
}

/// Runs a pipeline file in a lake, and says whether no item was skipped; `progress` is called with each event.
///
/// # Errors
///
/// Fails with an exception that says what the run says, with that of a signal's handler, and with that of `progress`:
/// the run is ended before.
pub(crate) fn run(
    py: Python<'_>,
    lake: &Path,
    given: &Given<'_, '_>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<bool> {
    let mut command = command(py, lake, given)?;
    let mut child = command.spawn().map_err(|err| {
        wrong(
            format!("the run cannot be started: {err}"),
            "check that the environment of Python is whole: `python -m pipeline --version`",
        )
    })?;
    let (Some(events), Some(said)) = (child.stdout.take(), child.stderr.take()) else {
        return Err(wrong("the run has no output".to_owned(), "try again"));
    };
    let said = thread::spawn(move || {
        let mut text = String::new();
        let _what_came = BufReader::new(said).read_to_string(&mut text);
        text
    });
    let (send, mut receive) = mpsc::channel();
    thread::spawn(move || {
        for line in BufReader::new(events).lines().map_while(Result::ok) {
            if send.send(line).is_err() {
                break;
            }
        }
    });
    let loads = py.import("json")?.getattr("loads")?;
    let mut raised = None;
    loop {
        let receive = &mut receive;
        let event = py.detach(move || receive.recv_timeout(PATIENCE));
        let went_on = match event {
            Ok(line) if raised.is_none() => progress.map_or(Ok(()), |progress| {
                progress.call1((loads.call1((line,))?,)).map(drop)
            }),
            Ok(_) | Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => break,
        };
        if let Err(err) = went_on.and_then(|()| signals(py)) {
            // It drops what it is making, and keeps the rest; the second time it ends at once.
            interrupt(&child);
            raised.get_or_insert(err);
        }
    }
    let ended = py.detach(|| child.wait());
    let said = py.detach(|| said.join()).unwrap_or_default();
    match (raised, ended) {
        (Some(err), _) => Err(err),
        (None, Ok(status)) => outcome(status, &said),
        (None, Err(err)) => Err(wrong(format!("the run was lost: {err}"), "run it again")),
    }
}

/// Returns the command of a run, which no Ctrl-C of the terminal reaches but through this process.
fn command(py: Python<'_>, lake: &Path, given: &Given<'_, '_>) -> PyResult<Command> {
    use std::os::unix::process::CommandExt;

    let python = py.import("sys")?.getattr("executable")?;
    let python: PathBuf = python.extract().map_err(|_none: PyErr| {
        wrong(
            "nobody knows the program of this Python: `sys.executable` is not set".to_owned(),
            "set `sys.executable` to the Python of the environment",
        )
    })?;
    let mut command = Command::new(python);
    command.args(["-c", PROGRAM]).arg(joined("--lake=", lake));
    command.args(["run", "--format=json"]);
    command.env(pipeline::ENDS_WITH_PARENT, "1");
    command.stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.process_group(0);
    for (option, value) in [("--profile", given.profile), ("--until", given.until)] {
        command.args(value.map(|value| format!("{option}={value}")));
    }
    command.args(given.jobs.map(|jobs| format!("--jobs={jobs}")));
    let mut values = Vec::new();
    if let Some(set) = given.set {
        flatten(set, "", &mut values)?;
    }
    command.args(values.iter().map(|value| format!("--set={value}")));
    command.arg("--").arg(given.file);
    Ok(command)
}

/// Returns an option with a path as its value.
fn joined(option: &str, path: &Path) -> OsString {
    let mut word = OsString::from(option);
    word.push(path);
    word
}

/// Adds the values of a dict by their dotted keys, those of dicts in it too.
fn flatten(set: &Bound<'_, PyDict>, above: &str, values: &mut Vec<String>) -> PyResult<()> {
    for (key, value) in set {
        let key = format!("{above}{}", key.extract::<String>()?);
        match value.cast::<PyDict>() {
            Ok(below) => flatten(below, &format!("{key}."), values)?,
            Err(_) => values.push(format!("{key}={}", value_text(&value)?)),
        }
    }
    Ok(())
}

/// Returns a value as the command line has it: lists and texts as in TOML, which are those of JSON.
fn value_text(value: &Bound<'_, PyAny>) -> PyResult<String> {
    let json = value.py().import("json")?;
    // A number of numpy is one of Python's.
    let value = match value.getattr_opt("item")? {
        Some(item) if value.getattr("ndim")?.eq(0)? => item.call0()?,
        _ => value.clone(),
    };
    let text = json.call_method1("dumps", (&value,)).map_err(|err| {
        wrong(
            format!(
                "`set` has a value that cannot be used: {}",
                err.value(value.py())
            ),
            "pass numbers, texts and lists",
        )
    })?;
    text.extract()
}

/// Ends a run as Ctrl-C does.
fn interrupt(child: &Child) {
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    if let Some(pid) = pid {
        let _it_may_have_ended = kill_process(pid, Signal::INT);
    }
}

/// Returns whether no item was skipped, or the exception for a run that failed.
fn outcome(status: ExitStatus, said: &str) -> PyResult<bool> {
    match status.code() {
        Some(0) => Ok(true),
        Some(SKIPPED) => Ok(false),
        _ => {
            let text = said.split_once("error: ").map_or(said, |(_, error)| error);
            let (what, hint) = text.split_once("\nhint: ").unwrap_or((text, ""));
            let what = if what.trim().is_empty() {
                format!("the run ended with {status}")
            } else {
                what.trim().to_owned()
            };
            let hint = Some(hint.trim()).filter(|hint| !hint.is_empty());
            Err(raised(what, hint.map(str::to_owned)))
        }
    }
}
