//! Units made in other processes: `pipeline unit --order -`, on this machine or, behind a prefix such as `srun` or
//! `ssh HOST`, on another. Each process makes one unit after the other, since its start costs more than a short one.

use std::{
    env,
    ffi::OsString,
    io::{self, BufRead, BufReader, Write},
    process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::Mutex,
    thread,
};

use dataflow::{Events, Executor, Failure, OnOutcome, Relay, UnitOutcome, Wave, WorkItem};
use lake::Lake;

use crate::{invocation, jobs::Job, outcome::CommandError, sharing};

/// Makes units in processes that read work items from stdin and write events to stdout, a line each.
pub(crate) struct Processes<'a> {
    /// The lake, whose depot the processes use.
    pub(crate) lake: &'a Lake,
    /// The command line of a worker, without the work item.
    pub(crate) worker: Vec<OsString>,
    /// Lake that the workers use.
    pub(crate) reach: Reach,
    /// Processes at once.
    pub(crate) at_once: usize,
    /// Whether the other units of an output are made when one fails.
    pub(crate) keep_going: bool,
    /// Those that wait for a work item.
    pub(crate) idle: Idle,
}

/// Processes that have made their units, and wait for others.
pub(crate) type Idle = Mutex<Vec<Process>>;

/// A process that makes units. It ends when its stdin closes, at the latest when this process ends.
pub(crate) struct Process {
    child: Child,
    stdin: ChildStdin,
    lines: BufReader<ChildStdout>,
}

/// Lake that a worker uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// That of the run.
    SameLake,
    /// One of its own.
    DepotAlone,
}

impl Executor for Processes<'_> {
    fn keeps_going(&self) -> bool {
        self.keep_going
    }

    fn execute(&self, wave: &Wave, events: &Events, on_outcome: &OnOutcome) -> Result<(), Failure> {
        wave.each(
            self.at_once,
            self.keep_going,
            (events, on_outcome),
            |item| self.make(item, events),
        );
        // The next output may have none for them.
        for process in clock::lock(&self.idle).drain(..) {
            let _ended = process.end();
        }
        Ok(())
    }
}

impl<'a> Processes<'a> {
    /// Makes units in processes of this machine, in the run's own lake.
    pub(crate) fn local(lake: &'a Lake, jobs: Option<u16>) -> Result<Self, CommandError> {
        let program = invocation::executable().map_err(|err| CommandError::failed(err, None))?;
        let worker = ["unit", "--lake"].map(OsString::from);
        let mut worker = [[program.into()].as_slice(), &worker].concat();
        worker.push(lake.root().into());
        let cores = || thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            lake,
            worker,
            reach: Reach::SameLake,
            at_once: jobs.map_or_else(cores, usize::from),
            keep_going: false,
            idle: Idle::default(),
        })
    }

    fn make(&self, item: &WorkItem, events: &Events) -> UnitOutcome {
        if self.reach == Reach::DepotAlone
            && let Some(end) = sharing::upload_inputs(self.lake, item)
        {
            return end;
        }
        let mut relay = Relay::new(item, events);
        match self.run_item(item, &mut relay) {
            Err(end) => end,
            Ok(status) => relay.end().unwrap_or_else(|| {
                let how = status.map_or_else(String::new, described);
                UnitOutcome::lost(format!("its process ended {how}"))
            }),
        }
    }

    /// Starts a worker that makes nothing; returns the name of its machine.
    pub(crate) fn try_out(&self) -> Result<String, Failure> {
        let failed = |why: String| Failure::Executor {
            message: format!("no worker comes up: {why}"),
            hint: Some("see what it says above, and whether the program is there".to_owned()),
        };
        let nothing = Job {
            folder: env::current_dir().map_err(|err| failed(err.to_string()))?,
            heartbeat_s: None,
            limit_s: None,
            items: Vec::new(),
        };
        let nothing = serde_json::to_string(&nothing).map_err(|err| failed(err.to_string()))?;
        let tried = || {
            let mut process = self.start()?;
            process.stdin.write_all(format!("{nothing}\n").as_bytes())?;
            let mut said = String::new();
            process.lines.read_line(&mut said)?;
            Ok((process.end()?, said))
        };
        let (status, said) = tried().map_err(|err: io::Error| failed(err.to_string()))?;
        if status.success() {
            Ok(said.trim().to_owned())
        } else {
            Err(failed(format!("it ended {}", described(status))))
        }
    }

    /// Has a process make a unit, and passes its events on; returns how it ended, if it has.
    fn run_item(
        &self,
        item: &WorkItem,
        relay: &mut Relay,
    ) -> Result<Option<ExitStatus>, UnitOutcome> {
        let lost = |err: io::Error| UnitOutcome::lost(format!("its process cannot be run: {err}"));
        let job = Job {
            folder: env::current_dir().map_err(lost)?,
            heartbeat_s: None,
            limit_s: None,
            items: vec![item.clone()],
        };
        let item = serde_json::to_string(&job).map_err(|err| lost(err.into()))?;
        let idle = clock::lock(&self.idle).pop();
        let mut process = idle.map_or_else(|| self.start(), Ok).map_err(lost)?;
        // One that ends before it has read everything says why, or is lost.
        let _read = process.stdin.write_all(format!("{item}\n").as_bytes());
        let mut line = String::new();
        while !relay.is_over() {
            line.clear();
            let read = process.lines.read_line(&mut line).map_err(lost);
            let relayed = match read {
                Ok(0) => return process.end().map(Some).map_err(lost),
                Ok(_) => relay.line(line.trim_end()).map_err(UnitOutcome::Failed),
                Err(end) => Err(end),
            };
            if let Err(end) = relayed {
                // It has no listener any more; if it cannot be killed, it ends by itself.
                let _killed = process.child.kill();
                let _ended = process.end();
                return Err(end);
            }
        }
        clock::lock(&self.idle).push(process);
        Ok(None)
    }

    fn start(&self) -> io::Result<Process> {
        let mut words = self.worker.iter();
        let program = words.next().ok_or(io::ErrorKind::InvalidInput)?;
        let mut command = Command::new(program);
        command.args(words).args(["--order", "-"]);
        if self.lake.is_depot_down() {
            // So that not every process waits for it.
            command.env_remove(sharing::VARIABLE);
        }
        let spawned = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child = spawned?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let (stdin, stdout) = stdin.zip(stdout).ok_or(io::ErrorKind::BrokenPipe)?;
        Ok(Process {
            child,
            stdin,
            lines: BufReader::new(stdout),
        })
    }
}

impl Process {
    /// Lets it end, and waits for that.
    fn end(self) -> io::Result<ExitStatus> {
        let Self {
            mut child, stdin, ..
        } = self;
        drop(stdin);
        child.wait()
    }
}

/// Description of a process's exit status.
fn described(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("with exit code {code} and no result"),
        (None, Some(signal)) => format!("by signal {signal}"),
        (None, None) => "for a reason unknown".to_owned(),
    }
}
