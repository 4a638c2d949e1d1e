//! A worker: makes the work items that a run sends, and reports their ends on stdout or in the depot.

use std::{
    env, fs,
    io::{self, BufRead},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, OnceLock, PoisonError, mpsc},
    thread,
    time::{Duration, Instant},
};

use dataflow::{Digest, Event, Events, Failure, UnitOutcome, WorkItem, WorkItemRunner};
use lake::{Lake, Sharing};
use tempfile::TempDir;

use crate::{
    arguments::UnitArgs,
    batch::for_shell,
    command_line::Program,
    heartbeats, interrupt,
    jobs::{self, Job},
    label::Label,
    outages,
    outcome::{CommandError, CommandOutcome},
    report, sharing,
};

/// Time in which a worker tries to leave its result in the depot where its job has no limit: nobody waits longer.
const DAY: Duration = Duration::from_hours(24);

/// The end of the time that Slurm gives a job, in seconds since 1970.
const JOB_END: &str = "SLURM_JOB_END_TIME";

/// Part of its time that a worker keeps to say where a result lies, and at most how much.
const LAST: u32 = 10;
const LONGEST_LAST: Duration = Duration::from_secs(30);

/// The folder of this worker's lake, if it has one of its own.
static SCRATCH: OnceLock<PathBuf> = OnceLock::new();

/// Makes the work items on stdin, or those of a job in the depot.
pub(crate) fn work(
    program: &Program,
    args: &UnitArgs,
    job: &str,
) -> Result<CommandOutcome, CommandError> {
    let own = args.scratch.as_deref().map(scratch).transpose()?;
    // Relative to the folder in which it was started, not to that of the run.
    let root = own.as_deref().unwrap_or(&program.lake);
    let root = std::path::absolute(root).map_err(|err| CommandError::failed(err, None))?;
    let began = clock::now();
    let lake = Lake::open(&root);
    let lake = Arc::new(match (sharing::depot()?, &own) {
        (Some(depot), Some(_)) => {
            lake.with_depot(&depot, &outages::worker_sharing(time_left().unwrap_or(DAY)))
        }
        // The run has looked up what it asks for.
        (Some(depot), None) => lake.with_depot(&depot, &Sharing::default()),
        (None, _) => lake,
    });
    if let Some(own) = own {
        SCRATCH.get_or_init(|| own);
    }
    interrupt::drop_on_signal(&lake)?;
    let lines = Lines::default();
    let jobs = args.jobs.map_or(0, usize::from);
    let worker = Worker {
        runner: WorkItemRunner::new(program.kinds, lake.as_ref(), jobs),
        lake: &lake,
        events: &|event: &Event| lines.write(event),
        sends: SCRATCH.get().is_some(),
        began,
        limit: OnceLock::new(),
    };
    let outcome = if job == "-" {
        worker.stdin_job()
    } else {
        worker.job(job)
    };
    lake.leave();
    leave_scratch(&lake);
    outcome.and_then(|()| lines.finish().map(|()| CommandOutcome::Done))
}

/// Removes the folder of this worker's lake, if it has one of its own; results that are not in the depot stay, and
/// it says where.
pub(crate) fn leave_scratch(lake: &Lake) {
    let Some(folder) = SCRATCH.get() else {
        return;
    };
    let n_waiting = lake
        .sharing()
        .ok()
        .flatten()
        .map_or(0, |it| it.n_units_waiting);
    if n_waiting == 0 {
        // What is left there is removed with the machine's temporary files.
        let _gone = fs::remove_dir_all(folder);
        return;
    }
    report::line(
        Label::Kept,
        format!(
            "{n_waiting} results that are not in the depot lie on `{}` in `{}`\n\
         hint: `pipeline push --lake {}` sends them from there",
            lake::host(),
            folder.display(),
            for_shell(&folder.display().to_string())
        ),
    );
}

/// Time that this job has left, as Slurm says.
fn time_left() -> Option<Duration> {
    lake::time_until(env::var(JOB_END).ok()?.parse().ok()?)
}

/// What makes work items.
pub(crate) struct Worker<'a> {
    pub(crate) runner: WorkItemRunner<'a>,
    pub(crate) lake: &'a Arc<Lake>,
    /// Receives events.
    pub(crate) events: &'a Events<'a>,
    /// Whether a result counts when it is in the depot.
    pub(crate) sends: bool,
    /// When it began, and the time that its job has, if that is limited.
    pub(crate) began: Instant,
    pub(crate) limit: OnceLock<Duration>,
}

impl Worker<'_> {
    /// Makes the work items that come as lines on stdin, until stdin closes; if it closes meanwhile, the run has ended,
    /// and the worker stops at once.
    fn stdin_job(&self) -> Result<(), CommandError> {
        let (sender, lines) = mpsc::channel();
        let is_busy = Arc::new(Mutex::new(false));
        let (lake, has_job) = (Arc::clone(self.lake), Arc::clone(&is_busy));
        thread::spawn(move || {
            let sent = io::stdin().lock().lines().try_for_each(|line| {
                *clock::lock(&has_job) = true;
                sender.send(line).map_err(|_ended| ())
            });
            // Kept, so that no other unit is begun.
            let has_job = clock::lock(&has_job);
            if *has_job && sent.is_ok() {
                interrupt::stop(&lake);
            }
        });
        for line in lines {
            let line = line.map_err(|err| CommandError::failed(err, None))?;
            let job: Job = serde_json::from_str(&line).map_err(unreadable)?;
            // The run may close stdin as soon as the end is told.
            let be_idle = || *clock::lock(&is_busy) = false;
            if job.items.is_empty() {
                be_idle();
                report::data(format!("{}\n", lake::host()).as_bytes())?;
            }
            self.each(&job, |_, _| {
                be_idle();
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Makes the work items of a job in the depot, one after the other, and leaves the end of each there.
    pub(crate) fn job(&self, name: &str) -> Result<(), CommandError> {
        let bytes = self.lake.message(&jobs::job_key(name))?;
        let bytes = bytes.ok_or_else(|| {
            CommandError::failed(anyhow::anyhow!("no job `{name}` is in the depot"), None)
        })?;
        let job: Job = serde_json::from_slice(&bytes).map_err(unreadable)?;
        let limit = job.limit_s.map(Duration::from_secs);
        limit.map(|limit| self.limit.set(limit));
        let here = jobs::here_key(name);
        self.lake.leave_message(&here, lake::host().as_bytes())?;
        let work = || {
            self.each(&job, |item, end| {
                let bytes =
                    serde_json::to_vec(end).map_err(|err| CommandError::failed(err, None))?;
                let key = jobs::end_key(name, &item.fingerprint);
                Ok(self.lake.leave_message(&key, &bytes)?)
            })
        };
        let Some(period_s) = job.heartbeat_s else {
            return work();
        };
        let mut n: u64 = 0;
        let beat = || {
            n += 1;
            let heartbeat = format!("{} {n}", lake::host());
            // One that is missed is followed by others.
            let _left = self.lake.leave_heartbeat(&here, heartbeat.as_bytes());
        };
        heartbeats::during(Duration::from_secs(period_s), beat, work)
    }

    /// Makes work items one after the other, and tells how each ended.
    fn each(
        &self,
        job: &Job,
        tell: impl Fn(&WorkItem, &Event) -> Result<(), CommandError>,
    ) -> Result<(), CommandError> {
        // Relative paths lead from the folder of the run, where this machine has it.
        let _stays = env::set_current_dir(&job.folder);
        for item in &job.items {
            let end = self.make(item)?;
            tell(item, &end)?;
            (self.events)(&end);
        }
        Ok(())
    }

    /// Makes the unit of a work item; returns its last event.
    fn make(&self, item: &WorkItem) -> Result<Event, CommandError> {
        let unit = item.unit.clone();
        let done = |made_now| Event::UnitDone {
            unit: item.unit.clone(),
            fingerprint: item.fingerprint,
            made_now,
            skipped: None,
        };
        // Another machine may have made it since the run sent it.
        if self.sends && !item.is_forced() && self.lake.announce(&item.fingerprint) {
            return Ok(done(false));
        }
        let made = self.runner.make(item, self.events);
        Ok(match made {
            Ok(UnitOutcome::Done { made_now }) => {
                if self.sends {
                    self.send(&item.fingerprint)?;
                }
                done(made_now)
            }
            Ok(UnitOutcome::Lost { missing, .. }) => Event::UnitLacking {
                unit,
                lacks: missing,
            },
            Ok(UnitOutcome::Failed(err)) | Err(err) => self.failed(item, err),
        })
    }

    /// Sends a result, without which it is none, for as long as the job has time.
    fn send(&self, fingerprint: &Digest) -> Result<(), CommandError> {
        self.lake.send_all(self.sending_time())?;
        let shared = self.lake.sharing()?;
        let Some(shared) = shared.filter(|it| it.n_units_waiting > 0) else {
            return Ok(());
        };
        let why = shared
            .unsent
            .unwrap_or_else(|| "it was not sent in time".to_owned());
        let message = format!("the result of {fingerprint} could not be left in the depot: {why}");
        Err(CommandError::failed(anyhow::anyhow!(message), None))
    }

    /// Time in which results can be sent: that of the job, but for a last part in which it says where they lie.
    fn sending_time(&self) -> Duration {
        let limit = self.limit.get();
        let of_job = limit.map(|limit| limit.saturating_sub(clock::since(self.began)));
        let Some(left) = time_left().into_iter().chain(of_job).min() else {
            return DAY;
        };
        left.saturating_sub((left / LAST).min(LONGEST_LAST))
    }

    /// A hint for people on another machine, where there is no lake of this worker: what lies in it was printed.
    fn without_scratch(&self, item: &WorkItem, hint: &str) -> String {
        match self.lake.log(&item.fingerprint) {
            Some(log) if self.sends => {
                hint.replace(&format!("`{}`", log.display()), "the log of its job")
            }
            _ => hint.to_owned(),
        }
    }

    fn failed(&self, item: &WorkItem, err: Failure) -> Event {
        // What a program printed goes where what this process prints goes.
        if let Some(log) = self.lake.log(&item.fingerprint)
            && let Ok(text) = fs::read(log)
        {
            report::plain(String::from_utf8_lossy(&text).trim_end());
        }
        let (hint, left_out) = err.advice();
        let hint = hint.map(|hint| self.without_scratch(item, &hint));
        let left_out = left_out.cloned();
        let message = match CommandError::from(err) {
            CommandError::Failed { error, .. } => report::chain(&error),
            CommandError::Usage { message, .. } => message,
            CommandError::File(err) => err.to_string(),
        };
        Event::UnitFailed {
            unit: item.unit.clone(),
            message,
            hint,
            left_out,
        }
    }
}

fn unreadable(err: serde_json::Error) -> CommandError {
    CommandError::failed(
        anyhow::Error::from(err).context("the work item cannot be parsed"),
        Some("install the same build of the program on every machine that makes units".to_owned()),
    )
}

/// Makes a folder for the lake of one worker.
fn scratch(folder: &Path) -> Result<PathBuf, CommandError> {
    let made = fs::create_dir_all(folder).and_then(|()| {
        // Its name is not the process's number: machines or containers may share the folder.
        tempfile::Builder::new()
            .prefix("pipeline-worker-")
            .tempdir_in(folder)
            .map(TempDir::keep)
    });
    made.map_err(|err| {
        let message = format!("cannot make a folder in `{}`", folder.display());
        CommandError::failed(anyhow::Error::from(err).context(message), None)
    })
}

/// Events written to stdout as lines of JSON.
#[derive(Default)]
struct Lines {
    /// The first write error.
    failed: Mutex<Option<CommandError>>,
}

impl Lines {
    fn write(&self, event: &Event) {
        let json = serde_json::to_string(event).map_err(|err| CommandError::failed(err, None));
        let written = json.and_then(|json| report::data(format!("{json}\n").as_bytes()));
        if let Err(trouble) = written {
            let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
            failed.get_or_insert(trouble);
        }
    }

    fn finish(&self) -> Result<(), CommandError> {
        let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        failed.take().map_or(Ok(()), Err)
    }
}
