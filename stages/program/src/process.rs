//! Running a program in a folder, within its limits.

use std::{
    collections::BTreeSet,
    io::{self, Write},
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
    limits::{ProcessEvent, read},
    log::Log,
    processes::{Processes, VARIABLE},
    script::FirstLine,
};

/// Interval between measurements of memory.
const MEASURE_EVERY: Duration = Duration::from_millis(200);
/// Time in which processes that the program started may end after it.
const GRACE: Duration = Duration::from_secs(2);
/// Interval between checks whether these have ended.
const ASK_EVERY: Duration = Duration::from_millis(10);
/// Outputs of a program: stdout and stderr.
const OUTPUTS: usize = 2;
/// Kills the group that it was told, and the processes with the folder `$0` in their environment, when its stdin
/// closes without `done`, because the process that started it has died.
const GUARD: &str = r#"group=
while read -r word; do
    [ "$word" = done ] && exit
    group=$word
done
[ -z "$group" ] || kill -KILL -- "-$group"
# Twice: one that was just beginning may be missed.
for pass in first second; do
    for process in /proc/[0-9]*; do
        if tr '\0' '\n' < "$process/environ" | grep -qxF "PIPELINE_UNIT=$0"; then
            kill -KILL "${process#/proc/}"
        fi
    done
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

/// End of a program that broke no limit.
pub(crate) struct ProgramEnd {
    pub(crate) status: ExitStatus,
}

impl ProgramEnd {
    /// Returns the end in words, e.g. `ended with exit code 1`.
    pub(crate) fn words(&self) -> String {
        match (self.status.code(), self.status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (None, Some(signal)) => format!("was ended by signal {signal}"),
            (None, None) => "ended for a reason unknown".to_owned(),
        }
    }
}

/// Kills a program's processes if this process dies.
struct Guard(Child);

impl Guard {
    /// Starts the guard of the unit in this folder.
    fn new(folder: &Path) -> io::Result<Self> {
        let mut command = Command::new("sh");
        command
            .args(["-c", GUARD])
            .arg(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0);
        command.spawn().map(Self)
    }

    /// Sends it one line.
    fn send(&mut self, word: &str) {
        if let Some(input) = &mut self.0.stdin {
            // If the guard has ended, only the death of this very process would leave the program behind.
            let _ended = writeln!(input, "{word}");
        }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.send("done");
        let _status = self.0.wait();
    }
}

/// A program that runs; when this is dropped, all its processes are killed.
struct RunningProgram {
    processes: Processes,
    guard: Option<Guard>,
    /// Whether none of them lives any more.
    is_over: bool,
}

impl RunningProgram {
    /// Starts the command; the lock is held, so that an interrupt finds it.
    fn new(command: &mut Command, folder: &Path) -> Result<(Self, Child), ProgramError> {
        let program = command.get_program().to_owned();
        let failed = |source: io::Error| ProgramError::NotStarted {
            program: program.to_string_lossy().into_owned(),
            script: (source.kind() != io::ErrorKind::PermissionDenied)
                .then(|| FirstLine::of(Path::new(&program)))
                .flatten(),
            source,
        };
        // Before the program: one that is left behind before the guard knows its group is found by its environment.
        let mut guard = Guard::new(folder).ok();
        let mut running = running();
        if running.stopped {
            return Err(ProgramError::Interrupted);
        }
        let child = command.spawn().map_err(failed)?;
        let lost = || ProgramError::NotStarted {
            program: program.to_string_lossy().into_owned(),
            script: None,
            source: io::Error::other("it has no process id"),
        };
        let processes = Processes::of(child.id(), folder).ok_or_else(lost)?;
        running.all.insert(processes.clone());
        drop(running);
        if let Some(guard) = &mut guard {
            guard.send(&child.id().to_string());
        }
        let started = Self {
            processes,
            guard,
            is_over: false,
        };
        Ok((started, child))
    }
}

impl Drop for RunningProgram {
    fn drop(&mut self) {
        if !self.is_over {
            self.processes.kill();
        }
        drop(self.guard.take());
        running().all.remove(&self.processes);
    }
}

/// Runs the command in a folder until this instant; `progress` receives its reports of progress.
pub(crate) fn run(
    config: &ProgramConfig,
    command: &[PathBuf],
    folder: &Path,
    until: Instant,
    log: &Arc<Log>,
    progress: &dyn Fn(f64, &str),
) -> Result<ProgramEnd, ProgramError> {
    let [program, arguments @ ..] = command else {
        return Err(ProgramError::NotStarted {
            program: String::new(),
            script: None,
            source: io::ErrorKind::NotFound.into(),
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
    let (started, child) = RunningProgram::new(&mut command, folder)?;
    let mut watch = Watch {
        config,
        until,
        log,
        progress,
        started,
        events: follow(child, log),
        n_closed: 0,
    };
    let status = watch.until_it_ends();
    let ended = status.and_then(|status| {
        watch.until_the_others_end()?;
        Ok(ProgramEnd {
            status: status.map_err(ProgramError::at(folder))?,
        })
    });
    // Kills the remaining processes.
    drop(watch);
    let ended = ended?;
    if running().stopped {
        return Err(ProgramError::Interrupted);
    }
    Ok(ended)
}

/// Reads both outputs of a program and waits for its end, in threads.
fn follow(mut child: Child, log: &Arc<Log>) -> mpsc::Receiver<ProcessEvent> {
    let (sender, events) = mpsc::channel();
    if let Some(stdout) = child.stdout.take() {
        let (log, sender) = (Arc::clone(log), sender.clone());
        thread::spawn(move || read(stdout, "stdout", &log, &sender));
    }
    if let Some(stderr) = child.stderr.take() {
        let (log, sender) = (Arc::clone(log), sender.clone());
        thread::spawn(move || read(stderr, "stderr", &log, &sender));
    }
    thread::spawn(move || {
        let _nobody_asks = sender.send(ProcessEvent::Ended(child.wait()));
    });
    events
}

/// A program that is being watched.
struct Watch<'a> {
    config: &'a ProgramConfig,
    until: Instant,
    log: &'a Log,
    progress: &'a dyn Fn(f64, &str),
    started: RunningProgram,
    events: mpsc::Receiver<ProcessEvent>,
    /// Number of its outputs that have closed.
    n_closed: usize,
}

impl Watch<'_> {
    fn killed(&self, problem: String, advice: &'static str) -> ProgramError {
        self.started.processes.kill();
        ProgramError::Killed {
            command: words(self.config),
            problem,
            last_lines: self.log.last_lines(),
            log: self.log.path().to_owned(),
            advice,
        }
    }

    /// Handles an event; returns the program's end.
    fn take(
        &mut self,
        happened: ProcessEvent,
    ) -> Result<Option<io::Result<ExitStatus>>, ProgramError> {
        match happened {
            ProcessEvent::Progress(share, message) => (self.progress)(share, &message),
            ProcessEvent::Closed => self.n_closed += 1,
            ProcessEvent::Flooded(problem, advice) => return Err(self.killed(problem, advice)),
            ProcessEvent::Ended(status) => return Ok(Some(status)),
        }
        Ok(None)
    }

    /// Waits for the program's first process, within the limits.
    fn until_it_ends(&mut self) -> Result<io::Result<ExitStatus>, ProgramError> {
        let ProgramConfig {
            timeout_s,
            memory_mb,
            ..
        } = *self.config;
        let until = self.until;
        let mut measured = Instant::now();
        loop {
            let now = Instant::now();
            if now >= until {
                let problem = format!("did not end within {timeout_s} s (`timeout_s`)");
                let advice = "find out what it waits for, or raise `timeout_s`";
                return Err(self.killed(problem, advice));
            }
            if now - measured >= MEASURE_EVERY {
                measured = now;
                let resident_mb = self.started.processes.resident_bytes() / 1_000_000;
                if resident_mb > memory_mb {
                    let problem = format!(
                        "held {resident_mb} MB of memory, more than {memory_mb} (`memory_mb`)"
                    );
                    let advice = "read less at a time, or raise `memory_mb`";
                    return Err(self.killed(problem, advice));
                }
            }
            if let Ok(happened) = self.events.recv_timeout(MEASURE_EVERY.min(until - now))
                && let Some(status) = self.take(happened)?
            {
                return Ok(status);
            }
        }
    }

    /// Waits a moment for the processes that it has started.
    fn until_the_others_end(&mut self) -> Result<(), ProgramError> {
        let since = Instant::now();
        while self.n_closed < OUTPUTS || self.started.processes.others_live() {
            if since.elapsed() >= GRACE {
                let problem = "ended and left processes behind".to_owned();
                let advice = "have it wait for the processes that it starts";
                return Err(self.killed(problem, advice));
            }
            match self.events.recv_timeout(ASK_EVERY) {
                Ok(happened) => drop(self.take(happened)?),
                // Both readers have ended.
                Err(mpsc::RecvTimeoutError::Disconnected) => thread::sleep(ASK_EVERY),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
            }
        }
        self.started.is_over = true;
        Ok(())
    }
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

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// This process dies before it can tell the guard the program's group.
    #[test]
    fn a_guard_that_knows_no_group_finds_the_program_by_its_environment() {
        let folder = tempfile::tempdir().unwrap();
        let mut guard = Guard::new(folder.path()).unwrap();
        let sleeping = |folder: &Path| {
            let mut command = Command::new("sleep");
            command.arg("600").env(VARIABLE, folder).process_group(0);
            command.spawn().unwrap()
        };
        let other = tempfile::tempdir().unwrap();
        let (mut left_behind, mut of_other) = (sleeping(folder.path()), sleeping(other.path()));
        drop(guard.0.stdin.take());
        let ended = left_behind.wait().unwrap();
        assert_eq!(ended.signal(), Some(9), "{ended}");
        assert!(of_other.try_wait().unwrap().is_none());
        of_other.kill().unwrap();
        of_other.wait().unwrap();
    }
}
