//! Watching the jobs that are out.

use std::{
    collections::{BTreeMap, HashMap},
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::Path,
    time::{Duration, Instant},
};

use dataflow::{Digest, Event, Events, Failure, OnOutcome, Store, UnitOutcome, Wave};

use super::{
    Array, Batch, POLL_PERIOD, described, failed, limit_s,
    queue::{JobState, Queue},
};
use crate::{jobs::here_key, label::Label, report};

/// Looks after which a job that is over and has left nothing counts as lost: files of another machine
/// may be seen late.
const LOOKS: usize = 4;

/// Places of a wave's units: in the queue or on machines.
#[derive(Default)]
struct Places {
    waiting: BTreeMap<String, usize>,
    running: BTreeMap<String, usize>,
    /// Whether a job will never start, or its worker sends no heartbeats.
    is_stuck: bool,
}

impl Places {
    /// Counts the units of a job in this state, of which nothing was heard for the time that `silence` says;
    /// returns why they are lost, unless they may still be made.
    fn count(
        &mut self,
        state: Option<&JobState>,
        silence: Option<&str>,
        n_units: usize,
    ) -> Option<String> {
        match (state, silence) {
            (Some(JobState::Waiting(reason)), _) => {
                *self.waiting.entry(reason.clone()).or_default() += n_units;
                None
            }
            (Some(JobState::Impossible(reason)), _) => {
                *self.waiting.entry(reason.clone()).or_default() += n_units;
                Some(format!("never starts ({reason})"))
            }
            (Some(JobState::Running(host)), None) => {
                *self.running.entry(host.clone()).or_default() += n_units;
                None
            }
            (Some(JobState::Running(host)), Some(silence)) => {
                self.is_stuck = true;
                Some(format!(
                    "is said to run on `{host}`, where nothing has {silence}"
                ))
            }
            (Some(JobState::Stuck(reason)), _) => {
                self.is_stuck = true;
                Some(format!("would wait for ever ({reason})"))
            }
            (Some(JobState::Over(state)), _) => {
                Some(format!("ended as {state} and left no result"))
            }
            (None, _) => Some("is unknown to the scheduler and left no result".to_owned()),
        }
    }
}

/// Observations of jobs, by their array and index.
#[derive(Default)]
struct JobObservations {
    /// Looks at which a job was over and had left nothing.
    missed: HashMap<(String, usize), usize>,
    /// The workers of jobs that are said to run.
    workers: HashMap<(String, usize), WorkerHeartbeat>,
}

/// Last heartbeat of the worker of a job.
struct WorkerHeartbeat {
    /// Its last heartbeat, if it has begun.
    heartbeat: Option<Vec<u8>>,
    at: Instant,
    /// Time of the last look at its heartbeat.
    looked: Instant,
}

impl Batch<'_> {
    /// Watches jobs until every unit has ended or one has failed; returns whether a job is stuck.
    pub(super) fn watch(
        &self,
        wave: &Wave,
        arrays: &[Array],
        open: &mut HashMap<Digest, usize>,
        events: &Events,
        on_outcome: &OnOutcome,
    ) -> Result<bool, Failure> {
        let mut seen = JobObservations::default();
        let mut shown = None;
        let mut is_told = false;
        let mut is_stuck = false;
        loop {
            // The outcomes of a job that is over now are seen in the look into the depot that
            // follows.
            let queue = self.look(arrays);
            let has_failed = self.collect(wave, arrays, open, on_outcome)?;
            if has_failed && !self.scheduler.keep_going || open.is_empty() {
                return Ok(is_stuck);
            }
            match queue {
                Ok(queue) => {
                    let places = self.compare(wave, arrays, &queue, open, &mut seen, on_outcome)?;
                    is_stuck |= places.is_stuck;
                    let now = Some((places.waiting, places.running));
                    if now != shown {
                        let (waiting, running) = now.clone().unwrap_or_default();
                        events(&Event::Queue {
                            output: wave.output().clone(),
                            on: self.name.clone(),
                            waiting,
                            running,
                        });
                        shown = now;
                    }
                }
                Err(err) if !is_told => {
                    report::line(Label::Wait, format!("{} does not answer: {err}", self.name));
                    is_told = true;
                }
                Err(_) => {}
            }
            if !open.is_empty() {
                clock::sleep(POLL_PERIOD);
            }
        }
    }

    /// Compares the scheduler's answer with the units that are still open: those of jobs that are over
    /// and have left nothing for a while are lost.
    fn compare(
        &self,
        wave: &Wave,
        arrays: &[Array],
        queue: &Queue,
        open: &mut HashMap<Digest, usize>,
        seen: &mut JobObservations,
        on_outcome: &OnOutcome,
    ) -> Result<Places, Failure> {
        let mut places = Places::default();
        let jobs = arrays.iter().flat_map(|array| {
            let jobs = array.jobs.iter().enumerate();
            jobs.map(move |(idx, job)| (array, idx, job))
        });
        for (array, job_idx, job) in jobs {
            let units = job.iter().filter(|unit| open.contains_key(unit));
            let units: Vec<Digest> = units.copied().collect();
            if units.is_empty() {
                continue;
            }
            let job = (array.name.clone(), job_idx);
            let state = queue.get(&job);
            let silence = if let Some(JobState::Running(_)) = state {
                self.silence(&job, seen)?
            } else {
                None
            };
            let Some(why) = places.count(state, silence.as_deref(), units.len()) else {
                seen.missed.remove(&job);
                continue;
            };
            let n_missed = seen.missed.entry(job.clone()).or_default();
            *n_missed += 1;
            if *n_missed < LOOKS {
                continue;
            }
            let units = self.without_made(units, open, on_outcome)?;
            if let Some(JobState::Impossible(reason)) = state {
                return Err(self.impossible(wave, reason));
            }
            let log = Log::new(self.log(array, job_idx));
            let why = format!(
                "job {job_idx} of {} {why}{}",
                array.name,
                log.named("; log ")
            );
            let cause = state.and_then(|state| self.cause(wave, array, state, &log));
            // It made its units one after the other: the first that is open is to blame.
            let mut to_blame = cause;
            for unit in units {
                let Some(idx) = open.remove(&unit) else {
                    continue;
                };
                let displaced = |states: &[String]| match state {
                    Some(JobState::Over(state)) => states.contains(state),
                    _ => false,
                };
                let end = match to_blame.take() {
                    Some((message, hint)) => UnitOutcome::Failed(Failure::Remote {
                        message: format!("{} {message}", wave.unit(idx)),
                        hint: Some(hint),
                        left_out: None,
                    }),
                    None if displaced(&self.scheduler.displaced)
                        || displaced(&self.scheduler.out_of_time)
                        || displaced(&self.scheduler.out_of_memory) =>
                    {
                        UnitOutcome::preempted(&why)
                    }
                    None => UnitOutcome::lost(&why),
                };
                on_outcome(idx, end);
            }
        }
        Ok(places)
    }

    /// Says why a job that is over could not have succeeded, and what to change, if its state or its log tells.
    fn cause(
        &self,
        wave: &Wave,
        array: &Array,
        state: &JobState,
        log: &Log,
    ) -> Option<(String, String)> {
        let JobState::Over(state) = state else {
            return None;
        };
        let resources = wave.resources();
        let n_in_job = array.jobs.iter().map(Vec::len).max().unwrap_or(1);
        let (needed, key) = if self.scheduler.out_of_time.contains(state) {
            let limit = limit_s(resources, n_in_job);
            let limit = limit.map(|limit_s| report::duration(limit_s as f64));
            let limit = limit.unwrap_or_else(|| "the time that a job gets by default".to_owned());
            (format!("needed more than {limit}"), "time_min")
        } else if self.scheduler.out_of_memory.contains(state)
            || log.says_one_of(&self.scheduler.out_of_memory_logs)
        {
            let limit = resources.memory_gb.map(|limit| format!("{limit} GB"));
            let limit = limit.unwrap_or_else(|| "the memory that a job gets by default".to_owned());
            (format!("needed more than {limit}"), "memory_gb")
        } else {
            return None;
        };
        let hint = format!(
            "raise `{key}` in `resources` of {}{}",
            place_of_resources(wave),
            log.named("; its log is ")
        );
        Some((needed, hint))
    }

    /// The failure of a wave whose jobs no machine takes.
    fn impossible(&self, wave: &Wave, reason: &str) -> Failure {
        Failure::Executor {
            message: format!(
                "`{}` never starts the jobs of `{}`: {reason}",
                self.name,
                wave.output()
            ),
            hint: Some(format!(
                "correct `resources` of {}, which ask for {}; `pipeline doctor {} --on {}` tests them",
                place_of_resources(wave),
                described(wave.resources()),
                wave.file().display(),
                self.name
            )),
        }
    }

    /// Ends those of these units whose results came to the depot without a word; returns the others.
    fn without_made(
        &self,
        units: Vec<Digest>,
        open: &mut HashMap<Digest, usize>,
        on_outcome: &OnOutcome,
    ) -> Result<Vec<Digest>, Failure> {
        let mut lost = Vec::new();
        for unit in units {
            let made = self.lake.arrived(&unit).map_err(Failure::Store)?;
            match open.get(&unit) {
                Some(&idx) if made.is_some() => {
                    open.remove(&unit);
                    on_outcome(idx, UnitOutcome::Done { made_now: true });
                }
                _ => lost.push(unit),
            }
        }
        Ok(lost)
    }

    /// Says for how long nothing was heard of the worker of a job that is said to run, if that is too long.
    fn silence(
        &self,
        job: &(String, usize),
        seen: &mut JobObservations,
    ) -> Result<Option<String>, Failure> {
        let (begin_s, timeout_s) = (self.scheduler.begin_s, self.scheduler.heartbeat_timeout_s);
        let now = clock::now();
        let last = seen.workers.entry(job.clone()).or_insert(WorkerHeartbeat {
            heartbeat: None,
            at: now,
            looked: now,
        });
        let longest_s = last.heartbeat.as_ref().map_or(begin_s, |_| timeout_s);
        let longest = Duration::from_secs(longest_s);
        // A request for each job at every look would be many.
        let pause = Duration::from_secs(begin_s.min(timeout_s) / 4);
        if clock::since(last.at) > longest || clock::since(last.looked) > pause {
            last.looked = now;
            let key = here_key(&format!("{}/{}", job.0, job.1));
            let heartbeat = self.lake.message(&key).map_err(failed)?;
            if heartbeat != last.heartbeat {
                last.heartbeat = heartbeat;
                last.at = now;
            }
        }
        // While the depot is down nobody is heard.
        let untroubled = self.lake.time_since_failure();
        let is_heard = untroubled.is_some_and(|since| since <= longest);
        let is_silent = clock::since(last.at) > longest && !is_heard;
        Ok(is_silent.then(|| match last.heartbeat {
            None => format!("begun for {begin_s} s"),
            Some(_) => format!("been heard for {timeout_s} s"),
        }))
    }

    /// Collects the outcomes that the jobs have left in the depot; returns whether a unit has
    /// failed.
    fn collect(
        &self,
        wave: &Wave,
        arrays: &[Array],
        open: &mut HashMap<Digest, usize>,
        on_outcome: &OnOutcome,
    ) -> Result<bool, Failure> {
        let mut has_failed = false;
        for array in arrays {
            let keys = self.lake.messages(&format!("ends/{}", array.name));
            for key in keys.map_err(failed)? {
                let name = key.rsplit('/').next().unwrap_or_default();
                let Ok(fingerprint) = name.parse::<Digest>() else {
                    continue;
                };
                let left = self.lake.message(&key).map_err(failed)?;
                if let (Some(left), Some(&idx)) = (left, open.get(&fingerprint)) {
                    let event = serde_json::from_slice(&left).ok();
                    let end = event.and_then(|event| {
                        UnitOutcome::of_event(event, &wave.unit(idx), &fingerprint)
                    });
                    let end =
                        end.unwrap_or_else(|| UnitOutcome::lost("its worker left no known event"));
                    has_failed |= matches!(end, UnitOutcome::Failed(_));
                    open.remove(&fingerprint);
                    let mut jobs = array.jobs.iter();
                    let job = jobs.position(|job| job.contains(&fingerprint));
                    on_outcome(
                        idx,
                        with_log(end, &self.log(array, job.unwrap_or_default())),
                    );
                    self.lake.remove_message(&key).map_err(failed)?;
                }
            }
        }
        Ok(has_failed)
    }
}

/// Where a wave's resources stand.
pub(super) fn place_of_resources(wave: &Wave) -> String {
    format!(
        "`[stages.{}]` in `{}`",
        wave.output().stage,
        wave.file().display()
    )
}

/// The log of a job.
struct Log {
    path: String,
    /// Its last bytes, if it is there.
    end: Option<String>,
}

impl Log {
    /// Reads the end of a log, where what ended a job stands.
    fn new(path: String) -> Self {
        const END: u64 = 16_384;
        let read = || {
            let mut file = File::open(&path)?;
            let size = file.metadata()?.len();
            file.seek(SeekFrom::Start(size.saturating_sub(END)))?;
            let mut end = Vec::new();
            file.read_to_end(&mut end)?;
            io::Result::Ok(String::from_utf8_lossy(&end).into_owned())
        };
        let end = read().ok();
        Self { path, end }
    }

    fn says_one_of(&self, words: &[String]) -> bool {
        let end = self.end.as_deref().unwrap_or_default();
        words.iter().any(|word| end.contains(word))
    }

    /// Its path after some words; nothing where there is no log.
    fn named(&self, before: &str) -> String {
        let path = self
            .end
            .as_ref()
            .map(|_| format!("{before}`{}`", self.path));
        path.unwrap_or_default()
    }
}

/// Adds the path of the log to the hint of a failure.
fn with_log(end: UnitOutcome, log: &str) -> UnitOutcome {
    match end {
        UnitOutcome::Failed(Failure::Remote {
            message,
            hint,
            left_out,
        }) if Path::new(log).exists() => {
            let log = format!("`less {log}` shows its log");
            UnitOutcome::Failed(Failure::Remote {
                message,
                hint: Some(hint.map_or_else(|| log.clone(), |hint| format!("{hint}; {log}"))),
                left_out,
            })
        }
        end => end,
    }
}
