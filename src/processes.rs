//! Units made in processes of their own: `pipeline unit --order -`, on this machine or, behind a prefix
//! such as `srun` or `ssh HOST`, on another.

use std::{
    env,
    ffi::OsString,
    io::{self, BufRead, BufReader, Read, Write},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
};

use dataflow::{End, Ended, Events, Executor, Failure, Order, Relay, Wave};
use lake::Lake;

use crate::{jobs::JobOrders, outcome::CommandError, sharing};

/// Makes each unit in a process of its own, which reads its order from stdin and writes its events to stdout.
pub(crate) struct Processes<'a> {
    /// The lake, whose depot the processes use.
    pub(crate) lake: &'a Lake,
    /// The command line of a worker, without the order.
    pub(crate) worker: Vec<OsString>,
    /// Lake that the workers use.
    pub(crate) reach: Reach,
    /// Processes at once.
    pub(crate) at_once: usize,
    /// Whether the other units of an output are made when one fails.
    pub(crate) keep_going: bool,
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

    fn carry_out(&self, wave: &Wave, events: &Events, ended: &Ended) -> Result<(), Failure> {
        wave.each(self.at_once, self.keep_going, (events, ended), |order| {
            self.make(order, events)
        });
        Ok(())
    }
}

impl<'a> Processes<'a> {
    /// Makes units in processes of this machine, in the run's own lake.
    pub(crate) fn here(lake: &'a Lake, jobs: Option<u16>) -> Result<Self, CommandError> {
        let program = env::current_exe().map_err(|err| CommandError::failed(err, None))?;
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
        })
    }

    fn make(&self, order: &Order, events: &Events) -> End {
        if self.reach == Reach::DepotAlone
            && let Some(end) = sharing::offer(self.lake, order)
        {
            return end;
        }
        let mut relay = Relay::new(order, events);
        match self.tell(order, &mut relay) {
            Err(end) => end,
            Ok(status) => relay
                .end()
                .unwrap_or_else(|| End::lost(format!("its process ended {}", described(status)))),
        }
    }

    /// Starts a worker that makes nothing; returns the name of its machine.
    pub(crate) fn try_out(&self) -> Result<String, Failure> {
        let failed = |why: String| Failure::Executor {
            message: format!("no worker comes up: {why}"),
            hint: Some("see what it says above, and whether the program is there".to_owned()),
        };
        let nothing = JobOrders {
            folder: env::current_dir().map_err(|err| failed(err.to_string()))?,
            heartbeat_s: None,
            limit_s: None,
            orders: Vec::new(),
        };
        let nothing = serde_json::to_string(&nothing).map_err(|err| failed(err.to_string()))?;
        let tried = || {
            let mut child = self.start()?;
            let mut stdin = child.stdin.take();
            if let Some(stdin) = &mut stdin {
                stdin.write_all(format!("{nothing}\n").as_bytes())?;
            }
            let mut said = String::new();
            if let Some(mut stdout) = child.stdout.take() {
                stdout.read_to_string(&mut said)?;
            }
            Ok((child.wait()?, said))
        };
        let (status, said) = tried().map_err(|err: io::Error| failed(err.to_string()))?;
        if status.success() {
            Ok(said.trim().to_owned())
        } else {
            Err(failed(format!("it ended {}", described(status))))
        }
    }

    /// Starts a worker, passes its events on, and waits for its end.
    fn tell(&self, order: &Order, relay: &mut Relay) -> Result<ExitStatus, End> {
        let lost = |err: io::Error| End::lost(format!("its process cannot be run: {err}"));
        let job = JobOrders {
            folder: env::current_dir().map_err(lost)?,
            heartbeat_s: None,
            limit_s: None,
            orders: vec![order.clone()],
        };
        let order = serde_json::to_string(&job).map_err(|err| lost(err.into()))?;
        let mut child = self.start().map_err(lost)?;
        // Its stdin closes when this process ends, however it ends.
        let mut stdin = child.stdin.take();
        if let Some(stdin) = &mut stdin {
            // One that ends before it has read everything says why, or is lost.
            let _read = stdin.write_all(format!("{order}\n").as_bytes());
        }
        let lines = child.stdout.take().map(BufReader::new);
        for line in lines.into_iter().flat_map(BufRead::lines) {
            let relayed = line.map_err(lost).and_then(|line| {
                let relayed = relay.line(&line);
                relayed.map_err(End::Failed)
            });
            if let Err(end) = relayed {
                // It has no listener any more; if it cannot be killed, it ends by itself.
                let _killed = child.kill();
                let _ended = child.wait();
                return Err(end);
            }
        }
        child.wait().map_err(lost)
    }

    fn start(&self) -> io::Result<Child> {
        let mut words = self.worker.iter();
        let program = words.next().ok_or(io::ErrorKind::InvalidInput)?;
        let mut command = Command::new(program);
        command.args(words).args(["--order", "-"]);
        if self.lake.is_depot_down() {
            // So that not every process waits for it.
            command.env_remove(sharing::VARIABLE);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()
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
