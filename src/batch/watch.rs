//! Watching the jobs that are out.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
    thread,
    time::{Duration, Instant},
};

use dataflow::{Digest, End, Ended, Event, Events, Failure, Store, Wave};

use super::{
    Array, Batch, POLL_PERIOD, failed,
    queue::{JobState, Queue},
};
use crate::{jobs::here_key, report};

/// Looks after which a job that is over and has left nothing counts as lost: files of another machine
/// may be seen late.
const LOOKS: usize = 4;

/// Places of a wave's units: in the queue or on machines.
#[derive(Default)]
struct Places {
    n_waiting: usize,
    running: BTreeMap<String, usize>,
    /// Whether a job will never start, or its worker sends no heartbeats.
    is_stuck: bool,
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
        ended: &Ended,
    ) -> Result<bool, Failure> {
        let mut seen = JobObservations::default();
        let mut shown = None;
        let mut is_told = false;
        let mut is_stuck = false;
        loop {
            // The outcomes of a job that is over now are seen in the look into the depot that
            // follows.
            let queue = self.look(arrays);
            if self.collect(wave, arrays, open, ended)? || open.is_empty() {
                return Ok(is_stuck);
            }
            match queue {
                Ok(queue) => {
                    let places = self.compare(arrays, &queue, open, &mut seen, ended)?;
                    is_stuck |= places.is_stuck;
                    let now = Some((places.n_waiting, places.running));
                    if now != shown {
                        let (n_waiting, running) = now.clone().unwrap_or_default();
                        events(&Event::Queue {
                            output: wave.output().clone(),
                            on: self.name.clone(),
                            n_waiting,
                            running,
                        });
                        shown = now;
                    }
                }
                Err(err) if !is_told => {
                    report::line(&format!("wait   {} does not answer: {err}", self.name));
                    is_told = true;
                }
                Err(_) => {}
            }
            if !open.is_empty() {
                thread::sleep(POLL_PERIOD);
            }
        }
    }

    /// Compares the scheduler's answer with the units that are still open: those of jobs that are over
    /// and have left nothing for a while are lost.
    fn compare(
        &self,
        arrays: &[Array],
        queue: &Queue,
        open: &mut HashMap<Digest, usize>,
        seen: &mut JobObservations,
        ended: &Ended,
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
            let why = match queue.get(&job) {
                Some(JobState::Waiting) => {
                    places.n_waiting += units.len();
                    seen.missed.remove(&job);
                    continue;
                }
                Some(JobState::Running(host)) => match self.silence(&job, seen)? {
                    None => {
                        *places.running.entry(host.clone()).or_default() += units.len();
                        seen.missed.remove(&job);
                        continue;
                    }
                    Some(why) => {
                        places.is_stuck = true;
                        format!("is said to run on `{host}`, where nothing has {why}")
                    }
                },
                Some(JobState::Stuck(reason)) => {
                    places.is_stuck = true;
                    format!("would wait for ever ({reason})")
                }
                Some(JobState::Over(state)) => format!("ended as {state} and left no result"),
                None => "is unknown to the scheduler and left no result".to_owned(),
            };
            let n_missed = seen.missed.entry(job).or_default();
            *n_missed += 1;
            if *n_missed < LOOKS {
                continue;
            }
            let units = self.without_made(units, open, ended)?;
            let log = self.log(array, job_idx);
            let why = format!("job {job_idx} of {} {why}; log `{log}`", array.name);
            for unit in units {
                if let Some(idx) = open.remove(&unit) {
                    ended(idx, End::lost(&why));
                }
            }
        }
        Ok(places)
    }

    /// Ends those of these units whose results came to the depot without a word; returns the others.
    fn without_made(
        &self,
        units: Vec<Digest>,
        open: &mut HashMap<Digest, usize>,
        ended: &Ended,
    ) -> Result<Vec<Digest>, Failure> {
        let mut lost = Vec::new();
        for unit in units {
            let made = self.lake.arrived(&unit).map_err(Failure::Store)?;
            match open.get(&unit) {
                Some(&idx) if made.is_some() => {
                    open.remove(&unit);
                    ended(idx, End::Done { made_now: true });
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
        let (begin_s, timeout_s) = (self.table.begin_s, self.table.heartbeat_timeout_s);
        let now = Instant::now();
        let last = seen.workers.entry(job.clone()).or_insert(WorkerHeartbeat {
            heartbeat: None,
            at: now,
            looked: now,
        });
        let longest_s = last.heartbeat.as_ref().map_or(begin_s, |_| timeout_s);
        let longest = Duration::from_secs(longest_s);
        // A request for each job at every look would be many.
        let pause = Duration::from_secs(begin_s.min(timeout_s) / 4);
        if last.at.elapsed() > longest || last.looked.elapsed() > pause {
            last.looked = now;
            let key = here_key(&format!("{}/{}", job.0, job.1));
            let heartbeat = self.lake.message(&key).map_err(failed)?;
            if heartbeat != last.heartbeat {
                last.heartbeat = heartbeat;
                last.at = now;
            }
        }
        // While the depot is down nobody is heard.
        let untroubled = self.lake.untroubled_for();
        let is_heard = untroubled.is_some_and(|since| since <= longest);
        let is_silent = last.at.elapsed() > longest && !is_heard;
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
        ended: &Ended,
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
                    let end =
                        event.and_then(|event| End::of_event(event, &wave.unit(idx), &fingerprint));
                    let end = end.unwrap_or_else(|| End::lost("its worker left no known event"));
                    has_failed |= matches!(end, End::Failed(_));
                    open.remove(&fingerprint);
                    let mut jobs = array.jobs.iter();
                    let job = jobs.position(|job| job.contains(&fingerprint));
                    ended(
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

/// Adds the path of the log to the hint of a failure.
fn with_log(end: End, log: &str) -> End {
    match end {
        End::Failed(Failure::Remote {
            message,
            hint,
            left_out,
        }) if Path::new(log).exists() => {
            let log = format!("`less {log}` shows its log");
            End::Failed(Failure::Remote {
                message,
                hint: Some(hint.map_or_else(|| log.clone(), |hint| format!("{hint}; {log}"))),
                left_out,
            })
        }
        end => end,
    }
}
