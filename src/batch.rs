//! Units made by the jobs of a scheduler, as Slurm.
//!
//! Work items go out as arrays of jobs, and come back as files in the depot: the outcome of each unit, beside
//! its record. The scheduler's answer about a job is a hint: a job that is over and has left nothing is lost.
//! An array is known by a name that is never given twice, since schedulers that have lost their state
//! give numbers again. The list of arrays that are out is in the depot too, so that a run whose process was killed
//! goes on with the jobs that it left.

mod adopt;
mod drivers;
pub(crate) mod queue;
mod scheduler;
mod submit;
mod watch;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    env, io,
    path::PathBuf,
    sync::{Mutex, PoisonError},
    time::Duration,
};

use dataflow::{Digest, Events, Executor, Failure, OnOutcome, Resources, UnitOutcome, Wave};
use lake::{Lake, LakeError};
use serde::{Deserialize, Serialize};

pub(crate) use self::scheduler::{Scheduler, default_true};
use self::{
    queue::{Queue, SchedulerCall},
    scheduler::Values,
    submit::{described, limit_s},
};
use crate::{
    invocation,
    jobs::{Job, here_key, job_key},
    label::Label,
    report, sharing,
};

/// Time between two looks at jobs.
const POLL_PERIOD: Duration = Duration::from_secs(2);

/// Looks for the answer of a job that makes nothing.
const TRIAL_LOOKS: u64 = 60;

/// Looks at a scheduler that does not answer, before any job is out.
const UNANSWERED_LOOKS: u64 = 300;

/// Seconds of a unit below which this process makes it itself, and of all of them together.
const SHORT_S: f64 = 5.0;
const SHORT_WAVE_S: f64 = 60.0;

/// Number of jobs of an array where the scheduler reports no limit.
const DEFAULT_ARRAY_JOBS: usize = 1000;

/// Commands that cancel the arrays that are out, by the arrays' names.
static OUT: Mutex<BTreeMap<String, Vec<String>>> = Mutex::new(BTreeMap::new());

/// Makes units by the jobs of a scheduler.
pub(crate) struct Batch<'a> {
    /// The name of its configuration.
    pub(crate) name: String,
    /// Its commands and the format of its answers.
    pub(crate) scheduler: Scheduler,
    /// The lake, with a depot.
    pub(crate) lake: &'a Lake,
    /// The depot, as workers name it.
    pub(crate) depot: String,
    /// Folder of the logs of jobs.
    pub(crate) logs: PathBuf,
    /// Runs its commands.
    pub(crate) ask: &'a SchedulerCall<'a>,
}

/// An array of jobs that is out.
#[derive(Serialize, Deserialize)]
struct Array {
    name: String,
    /// Identifier that the scheduler gave it, once it has taken it.
    id: Option<String>,
    /// The configuration by which it was submitted.
    on: String,
    /// The run that looks after it.
    driver: String,
    /// The fingerprints of the units of each job.
    jobs: Vec<Vec<Digest>>,
}

impl Executor for Batch<'_> {
    /// A wait in the queue costs more than a few short units.
    fn takes(&self, wave: &Wave) -> bool {
        let is_short =
            |took_s: f64| took_s < SHORT_S && took_s * (wave.len() as f64) < SHORT_WAVE_S;
        let is_long = wave.resources().gpus.is_some() || !wave.took_s.is_some_and(is_short);
        // What is queued or running already is waited for, or taken over.
        is_long || self.has_arrays(wave)
    }

    fn keeps_going(&self) -> bool {
        self.scheduler.keep_going
    }

    fn execute(&self, wave: &Wave, events: &Events, on_outcome: &OnOutcome) -> Result<(), Failure> {
        let mut open = HashMap::with_capacity(wave.len());
        for idx in 0..wave.len() {
            let item = wave.work_item(idx)?;
            match sharing::upload_inputs(self.lake, &item) {
                Some(UnitOutcome::Failed(err)) => return Err(err),
                Some(end) => on_outcome(idx, end),
                None => {
                    open.insert(item.fingerprint, idx);
                }
            }
        }
        let driver = unique_name();
        self.alive_during(&driver, || {
            self.make(wave, &driver, &mut open, events, on_outcome)
        })
    }
}

/// Cancels every array that is out; returns their names.
pub(crate) fn cancel_all() -> Vec<String> {
    let arrays = out(std::mem::take);
    for words in arrays.values() {
        let _gone = queue::ask(words, "");
    }
    arrays.into_keys().collect()
}

fn out<R>(change: impl FnOnce(&mut BTreeMap<String, Vec<String>>) -> R) -> R {
    change(&mut OUT.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Returns the values of the names in a scheduler's commands, for an array.
fn values_of(array: &Array) -> Values {
    let values = Values::default().with("name", &array.name);
    values.with_some("id", array.id.as_ref().map(|id| id as _))
}

/// Key of the message that an array is out.
fn key(wave: &Wave, name: &str) -> String {
    format!("waves/{}/{}/{name}", wave.pipeline(), wave.output())
}

fn digests(arrays: &[Array]) -> impl Iterator<Item = Digest> {
    arrays
        .iter()
        .flat_map(|array| array.jobs.iter().flatten().copied())
}

fn failed(err: LakeError) -> Failure {
    Failure::Store(err.into())
}

impl Batch<'_> {
    /// Makes units by jobs, new ones or those that a dead run has left.
    fn make(
        &self,
        wave: &Wave,
        driver: &str,
        open: &mut HashMap<Digest, usize>,
        events: &Events,
        on_outcome: &OnOutcome,
    ) -> Result<(), Failure> {
        let (mut arrays, rest, claim) = loop {
            let arrays = self.adopt(wave, driver, open, on_outcome)?;
            let adopted: BTreeSet<Digest> = digests(&arrays).collect();
            let rest = open.iter().filter(|(digest, _)| !adopted.contains(digest));
            let rest: HashMap<Digest, usize> = rest.map(|(unit, idx)| (*unit, *idx)).collect();
            if rest.is_empty() {
                break (arrays, rest, None);
            }
            if let Some(claim) = self.claim(wave, driver, &rest)? {
                break (arrays, rest, Some(claim));
            }
        };
        let mut rest: Vec<usize> = rest.into_values().collect();
        rest.sort_unstable();
        let submitted = self.submit(wave, driver, &rest, &mut arrays);
        if let Some(claim) = claim {
            // Where the depot is down it means nothing after this run.
            let _left = self.lake.remove_message(&claim);
        }
        let watched = match submitted {
            Ok(()) if arrays.is_empty() => Ok(false),
            Ok(()) => self.watch(wave, &arrays, open, events, on_outcome),
            Err(err) => Err(err),
        };
        if let Err(err) = &watched
            && self.lake.is_depot_offline()
        {
            for array in &arrays {
                out(|out| out.remove(&array.name));
            }
            return Err(self.left_alone(err, &arrays));
        }
        let is_left = watched.is_err() || !open.is_empty();
        for array in &arrays {
            // A job that is stuck, or whose result is no longer needed.
            if is_left || watched.as_ref().is_ok_and(|stuck| *stuck) {
                let _gone = (self.ask)(&self.cancellation(array), "");
            }
            out(|out| out.remove(&array.name));
            // Files left in a depot that is down are removed by its garbage collection.
            let _left = self.forget(wave, array);
        }
        watched.map(drop)
    }

    /// The failure of a run that leaves its jobs to themselves, since the depot stays down.
    fn left_alone(&self, err: &Failure, arrays: &[Array]) -> Failure {
        let then = if arrays.is_empty() {
            "the same command goes on from there".to_owned()
        } else {
            let words: Vec<String> = invocation::words()
                .iter()
                .map(|word| for_shell(&word.to_string_lossy()))
                .collect();
            format!(
                "its jobs are left in the queue of `{}` and keep their results until the depot is back; this \
                 takes them over: `{}`",
                self.name,
                words.join(" ")
            )
        };
        let (hint, _) = err.advice();
        Failure::Executor {
            message: report::sources(err),
            hint: Some(hint.map_or_else(|| then.clone(), |hint| format!("{hint}; {then}"))),
        }
    }

    /// Starts a job that makes nothing; returns the name of its machine.
    pub(crate) fn try_out(&self) -> Result<String, Failure> {
        let refused = |err: io::Error| self.refused(&err);
        let array = Array {
            name: unique_name(),
            id: None,
            on: self.name.clone(),
            driver: String::new(),
            jobs: vec![Vec::new()],
        };
        let job = format!("{}/0", array.name);
        let nothing = Job {
            folder: env::current_dir().map_err(refused)?,
            heartbeat_s: None,
            limit_s: None,
            items: Vec::new(),
        };
        self.leave(&job_key(&job), &nothing)?;
        self.make_logs(|| self.leave(&job_key(&job), &nothing))?;
        let mut answer = None;
        let submitted = self.submit_array(&array, &Resources::default(), 1);
        let mut n_looks = if submitted.is_ok() { TRIAL_LOOKS } else { 0 };
        while answer.is_none() && n_looks > 0 {
            clock::sleep(POLL_PERIOD);
            n_looks -= 1;
            answer = self.lake.message(&here_key(&job)).map_err(failed)?;
        }
        if answer.is_none() {
            let _gone = (self.ask)(&self.cancellation(&array), "");
        }
        for key in [job_key(&job), here_key(&job)] {
            self.lake.remove_message(&key).map_err(failed)?;
        }
        submitted?;
        let log = self.log(&array, 0);
        let silent = || Failure::Executor {
            message: format!(
                "a job on `{}` has not answered after {} s",
                self.name,
                TRIAL_LOOKS * POLL_PERIOD.as_secs()
            ),
            hint: Some(format!(
                "`less {log}` shows what it said, if it has run; it needs the program and the depot"
            )),
        };
        let host = answer.ok_or_else(silent)?;
        Ok(String::from_utf8_lossy(&host).into_owned())
    }

    fn refused(&self, err: &io::Error) -> Failure {
        Failure::Executor {
            message: format!("`{}` takes no jobs: {err}", self.name),
            hint: Some(format!("`pipeline doctor --on {}` tests it", self.name)),
        }
    }

    fn cancellation(&self, array: &Array) -> Vec<String> {
        values_of(array).words(&self.scheduler.cancel)
    }

    /// Asks for the states of all jobs of these arrays.
    fn look(&self, arrays: &[Array]) -> io::Result<Queue> {
        let names: Vec<&str> = arrays.iter().map(|array| array.name.as_str()).collect();
        let ids: Vec<&str> = arrays
            .iter()
            .filter_map(|array| array.id.as_deref())
            .collect();
        let values = Values::default()
            .with("names", &names.join(","))
            .with("ids", &ids.join(" "));
        Ok(queue::read(
            &self.scheduler,
            &(self.ask)(&values.words(&self.scheduler.query), "")?,
        ))
    }

    /// Asks until there is an answer, for a while.
    fn look_patiently(&self, arrays: &[Array]) -> Result<Queue, Failure> {
        let mut n_looks = 0;
        loop {
            match self.look(arrays) {
                Ok(queue) => return Ok(queue),
                Err(err)
                    if n_looks == UNANSWERED_LOOKS || err.kind() == io::ErrorKind::NotFound =>
                {
                    return Err(self.refused(&err));
                }
                Err(err) if n_looks == 0 => {
                    report::line(Label::Wait, format!("{} does not answer: {err}", self.name));
                }
                Err(_) => {}
            }
            n_looks += 1;
            clock::sleep(POLL_PERIOD);
        }
    }

    /// Number of jobs that one array may have.
    fn limit(&self) -> usize {
        let said = (self.ask)(&self.scheduler.limit, "").ok();
        let limit = said.and_then(|said| self.scheduler.limit_in(&said));
        // The number is that of the first index that is too large.
        limit.map_or(DEFAULT_ARRAY_JOBS, |limit| limit.max(1))
    }

    fn log(&self, array: &Array, job: usize) -> String {
        let values = values_of(array).with("index", &job);
        let name = values
            .words(std::slice::from_ref(&self.scheduler.log))
            .concat();
        self.logs.join(name).display().to_string()
    }

    /// Removes the files left in the depot for an array.
    fn forget(&self, wave: &Wave, array: &Array) -> Result<(), Failure> {
        self.forget_at(key(wave, &array.name), array)
    }

    fn forget_at(&self, wave_key: String, array: &Array) -> Result<(), Failure> {
        let mut keys = Vec::new();
        for below in ["orders", "here", "ends"] {
            let found = self.lake.messages(&format!("{below}/{}", array.name));
            keys.extend(found.map_err(failed)?);
        }
        // Last, so that the others are found if this is killed.
        keys.push(wave_key);
        let mut removed = keys.iter().map(|key| self.lake.remove_message(key));
        removed.try_for_each(|it| it).map_err(failed)
    }

    fn leave(&self, key: &str, message: &impl Serialize) -> Result<(), Failure> {
        let bytes = serde_json::to_vec(message).map_err(|err| self.refused(&err.into()))?;
        self.lake.leave_message(key, &bytes).map_err(failed)
    }
}

/// A name that no other array has.
fn unique_name() -> String {
    format!("pl{:016x}", clock::random())
}

/// A word as a shell reads it; plain words, and `~`, stay as they are.
pub(crate) fn for_shell(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./~:=@%+,-".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        quoted(word)
    }
}

/// A word as a shell reads it.
pub(crate) fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_never_given_twice_and_words_survive_a_shell() {
        assert_ne!(unique_name(), unique_name());
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(for_shell("~/lake"), "~/lake");
        assert_eq!(for_shell(""), "''");
        assert_eq!(for_shell("a b"), "'a b'");
    }
}
