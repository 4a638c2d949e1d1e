//! Running a program in a folder, within its limits.

use std::{
    collections::BTreeSet,
    io::Write,
    os::unix::process::{CommandExt, ExitStatusExt},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    sync::{Arc, Mutex, PoisonError, mpsc},
    thread,
    time::{Duration, Instant},
};

use crate::{
    config::ProgramConfig,
    error::ProgramError,
    limits::{Happened, read},
    log::Log,
    processes::{Processes, VARIABLE},
};

/// How often memory is measured.
const MEASURE_EVERY: Duration = Duration::from_millis(200);
/// Time in which processes that the program started may end after it.
const GRACE: Duration = Duration::from_secs(2);
/// How often it is asked whether they have.
const ASK_EVERY: Duration = Duration::from_millis(10);
/// Outputs of a program: stdout and stderr.
const OUTPUTS: usize = 2;
/// Kills the group `$0` when its stdin closes without a word, because the process that started it has died, and
/// the processes with the folder `$1` in their environment, which left the group.
const GUARD: &str = r#"read -r word && exit
kill -KILL -- "-$0"
for process in /proc/[0-9]*; do
    if tr '\0' '\n' < "$process/environ" | grep -qxF "PIPELINE_UNIT=$1"; then
        kill -KILL "${process#/proc/}"
    fi
done"#;

/// The programs that are running, unless the run is being interrupted.
static RUNNING: Mutex<Running> = Mutex::new(Running {
    stopped: false,
    all: BTreeSet::new(),
});

struct Running {
    stopped: bool,
    all: BTreeSet<Processes>,
}

fn running() -> std::sync::MutexGuard<'static, Running> {
    // Whole even if a thread panicked: every change is one call.
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Kills every program that is running, with all its processes, and starts no other: for an interrupt.
pub fn stop_all() {
    let mut running = running();
    running.stopped = true;
    for processes in &running.all {
        processes.kill();
    }
}

/// How a program that broke no limit ended.
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
}

impl Ended {
    /// Returns how it ended in words, e.g. `ended with exit code 1`.
    pub(crate) fn words(&self) -> String {
        match (self.status.code(), self.status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (None, Some(signal)) => format!("was ended by signal {signal}"),
            (None, None) => "ended for a reason unknown".to_owned(),
        }
    }
}

/// A program that runs; when this is dropped, all its processes are killed.
struct Started {
    processes: Processes,
    /// Kills the group if this process dies.
    guard: Option<Child>,
}

impl Started {
    /// Starts the command; the lock is held, so that an interrupt finds it.
    fn new(command: &mut Command, folder: &Path) -> Result<(Self, Child), ProgramError> {
        let program = command.get_program().to_owned();
        let failed = |source| ProgramError::NotStarted {
            program: program.to_string_lossy().into_owned(),
            source,
        };
        let mut running = running();
        if running.stopped {
            return Err(ProgramError::Interrupted);
        }
        let child = command.spawn().map_err(failed)?;
        let lost = || ProgramError::NotStarted {
            program: program.to_string_lossy().into_owned(),
            source: std::io::Error::other("it has no process id"),
        };
        let processes = Processes::of(child.id(), folder).ok_or_else(lost)?;
        running.all.insert(processes.clone());
        drop(running);
        // Without a guard, only the death of this very process would leave it behind.
        let guard = Command::new("sh")
            .args(["-c", GUARD])
            .arg(child.id().to_string())
            .arg(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn();
        let started = Self {
            processes,
            guard: guard.ok(),
        };
        Ok((started, child))
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        self.processes.kill();
        if let Some(mut guard) = self.guard.take() {
            if let Some(mut input) = guard.stdin.take() {
                let _ended = input.write_all(b"done\n");
            }
            let _status = guard.wait();
        }
        running().all.remove(&self.processes);
    }
}

/// Runs the command in a folder; `progress` is told what it says about its progress.
pub(crate) fn run(
    config: &ProgramConfig,
    command: &[PathBuf],
    folder: &Path,
    log: &Arc<Log>,
    progress: impl Fn(f64, &str),
) -> Result<Ended, ProgramError> {
    let [program, arguments @ ..] = command else {
        return Err(ProgramError::NotStarted {
            program: String::new(),
            source: std::io::ErrorKind::NotFound.into(),
        });
    };
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(folder)
        .env(VARIABLE, folder)
        .env("TMPDIR", folder.join(crate::folder::TMP))
        // Compiled code beside the sources would be code that changes while it runs.
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PYTHONUNBUFFERED", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0);
    let until = Instant::now() + Duration::from_secs_f64(config.timeout_s);
    let (started, mut child) = Started::new(&mut command, folder)?;
    let (sender, events) = mpsc::channel();
    if let Some(stdout) = child.stdout.take() {
        let (log, sender) = (Arc::clone(log), sender.clone());
        thread::spawn(move || read(stdout, "stdout", &log, &sender));
    }
    if let Some(stderr) = child.stderr.take() {
        let (log, sender) = (Arc::clone(log), sender.clone());
        thread::spawn(move || read(stderr, "stderr", &log, &sender));
    }
    let waiting = thread::spawn(move || {
        let _nobody_asks = sender.send(Happened::Ended(child.wait()));
    });
    let killed = |problem: String, advice: &'static str| ProgramError::Killed {
        command: words(config),
        problem,
        last_lines: log.last_lines(),
        log: log.path().to_owned(),
        advice,
    };
    let mut n_closed = 0;
    let mut measured = Instant::now();
    let status = loop {
        let now = Instant::now();
        if now >= until {
            drop(started);
            let problem = format!("did not end within {} s (`timeout_s`)", config.timeout_s);
            return Err(killed(
                problem,
                "find out what it waits for, or raise `timeout_s`",
            ));
        }
        if now - measured >= MEASURE_EVERY {
            measured = now;
            let resident_mb = started.processes.resident_bytes() / 1_000_000;
            if resident_mb > config.memory_mb {
                drop(started);
                let problem = format!(
                    "held {resident_mb} MB of memory, more than {} (`memory_mb`)",
                    config.memory_mb
                );
                return Err(killed(problem, "read less at a time, or raise `memory_mb`"));
            }
        }
        match events.recv_timeout(MEASURE_EVERY.min(until - now)) {
            Ok(Happened::Progress(share, message)) => progress(share, &message),
            Ok(Happened::Closed) => n_closed += 1,
            Ok(Happened::Flooded(problem, advice)) => {
                drop(started);
                return Err(killed(problem, advice));
            }
            Ok(Happened::Ended(status)) => break status,
            Err(_nothing_yet) => {}
        }
    };
    let _joined = waiting.join();
    let status = status.map_err(ProgramError::at(folder))?;
    let since = Instant::now();
    while n_closed < OUTPUTS || started.processes.others_live() {
        if since.elapsed() >= GRACE {
            drop(started);
            let problem = "ended and left processes behind".to_owned();
            return Err(killed(
                problem,
                "have it wait for the processes that it starts",
            ));
        }
        match events.recv_timeout(ASK_EVERY) {
            Ok(Happened::Progress(share, message)) => progress(share, &message),
            Ok(Happened::Closed) => n_closed += 1,
            Ok(Happened::Flooded(problem, advice)) => {
                drop(started);
                return Err(killed(problem, advice));
            }
            Ok(Happened::Ended(_)) => {}
            // Both readers have ended.
            Err(mpsc::RecvTimeoutError::Disconnected) => thread::sleep(ASK_EVERY),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
    }
    drop(started);
    if running().stopped {
        return Err(ProgramError::Interrupted);
    }
    Ok(Ended { status })
}

/// Returns the command as a person would write it, for errors.
pub(crate) fn words(config: &ProgramConfig) -> String {
    let words = config.command.iter().map(|word| {
        let is_plain = !word.is_empty() && !word.contains(char::is_whitespace);
        if is_plain {
            word.clone()
        } else {
            format!("'{word}'")
        }
    });
    words.collect::<Vec<_>>().join(" ")
}
