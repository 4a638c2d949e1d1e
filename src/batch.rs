//! Units made by the jobs of a scheduler, as Slurm.
//!
//! Orders go out as arrays of jobs, and come back as files in the depot: the outcome of each unit, beside its
//! record. The scheduler's answer about a job is a hint: a job that is over and has left nothing is lost.
//! An array is known by a name that is never given twice, since schedulers that have lost their state
//! give numbers again. The list of arrays that are out is in the depot too, so that a run whose process was killed
//! goes on with the jobs that it left.

mod adopt;
mod drivers;
mod queue;
mod table;
mod watch;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    env, fs, io,
    path::PathBuf,
    sync::{Mutex, PoisonError},
    thread,
    time::Duration,
};

use dataflow::{Digest, End, Ended, Events, Executor, Failure, Order, Resources, Wave};
use lake::{Lake, LakeError};
use serde::{Deserialize, Serialize};

pub(crate) use self::table::{Table, yes};
use self::{
    queue::{Queue, ask},
    table::Values,
};
use crate::{
    jobs::{JobOrders, here_key, orders_key},
    report, sharing,
};

/// Time between two looks at jobs.
const POLL_PERIOD: Duration = Duration::from_secs(2);

/// Times that an array is submitted before it counts as refused: a scheduler's message does not distinguish a
/// refusal from a shutdown.
const SUBMISSIONS: usize = 3;

/// Looks for the jobs of a submission that failed: they may be shown late.
const SUBMITTED_LOOKS: usize = 2;

/// Looks for the answer of a job that makes nothing.
const TRIAL_LOOKS: u64 = 60;

/// Looks at a scheduler that does not answer, before any job is out.
const UNANSWERED_LOOKS: u64 = 300;

/// Seconds that a job should take: what a scheduler costs, 0.1 to 0.5 s a job, does not count then.
const JOB_S: f64 = 45.0;

/// Seconds of a unit below which this process makes it itself, and of all of them together.
const SHORT_S: f64 = 5.0;
const SHORT_WAVE_S: f64 = 60.0;

/// Number of jobs for units of unknown duration.
const JOBS_OF_UNKNOWN_TIME: usize = 64;

/// Most jobs for one output, unless its units have a time limit, which a job of many would multiply: a
/// controller of Slurm holds 10,000 by default, of all users.
const MOST_JOBS: usize = 4000;

/// Number of jobs of an array where the scheduler reports no limit.
const DEFAULT_ARRAY_JOBS: usize = 1000;

/// Commands that cancel the arrays that are out, by the arrays' names.
static OUT: Mutex<BTreeMap<String, Vec<String>>> = Mutex::new(BTreeMap::new());

/// Makes units by the jobs of a scheduler.
pub(crate) struct Batch<'a> {
    /// The name of its configuration.
    pub(crate) name: String,
    /// Its commands and the format of its answers.
    pub(crate) table: Table,
    /// The lake, with a depot.
    pub(crate) lake: &'a Lake,
    /// The depot, as workers name it.
    pub(crate) depot: String,
    /// Folder of the logs of jobs.
    pub(crate) logs: PathBuf,
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
        self.table.keep_going
    }

    fn carry_out(&self, wave: &Wave, events: &Events, ended: &Ended) -> Result<(), Failure> {
        let mut open = HashMap::with_capacity(wave.len());
        for idx in 0..wave.len() {
            let order = wave.order(idx)?;
            match sharing::offer(self.lake, &order) {
                Some(End::Failed(err)) => return Err(err),
                Some(end) => ended(idx, end),
                None => {
                    open.insert(order.fingerprint, idx);
                }
            }
        }
        let driver = unique_name().map_err(|err| self.refused(&err))?;
        self.alive_during(&driver, || {
            self.make(wave, &driver, &mut open, events, ended)
        })
    }
}

/// Cancels every array that is out; returns their names.
pub(crate) fn cancel_all() -> Vec<String> {
    let arrays = out(std::mem::take);
    for words in arrays.values() {
        let _gone = ask(words, "");
    }
    arrays.into_keys().collect()
}

fn out<R>(change: impl FnOnce(&mut BTreeMap<String, Vec<String>>) -> R) -> R {
    change(&mut OUT.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Returns the values of the names in a table, for an array.
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
        ended: &Ended,
    ) -> Result<(), Failure> {
        let mut arrays = self.adopt(wave, driver, open, ended)?;
        let adopted: BTreeSet<Digest> = digests(&arrays).collect();
        let rest = open.iter().filter(|(digest, _)| !adopted.contains(digest));
        let mut rest: Vec<usize> = rest.map(|(_, idx)| *idx).collect();
        rest.sort_unstable();
        let submitted = self.submit(wave, driver, &rest, &mut arrays);
        let mut watched = match submitted {
            Ok(()) if arrays.is_empty() => Ok(false),
            Ok(()) => self.watch(wave, &arrays, open, events, ended),
            Err(err) => Err(err),
        };
        if let Err(err) = watched {
            if self.lake.is_depot_offline() {
                for array in &arrays {
                    out(|out| out.remove(&array.name));
                }
                return Err(self.left_alone(&err, &arrays));
            }
            watched = Err(err);
        }
        let is_left = watched.is_err() || !open.is_empty();
        for array in &arrays {
            // A job that is stuck, or whose result is no longer needed.
            if is_left || watched.as_ref().is_ok_and(|stuck| *stuck) {
                let _gone = ask(&self.cancellation(array), "");
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
            let words: Vec<String> = env::args().map(|word| for_shell(&word)).collect();
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
            name: unique_name().map_err(refused)?,
            id: None,
            on: self.name.clone(),
            driver: String::new(),
            jobs: vec![Vec::new()],
        };
        let job = format!("{}/0", array.name);
        let nothing = JobOrders {
            folder: env::current_dir().map_err(refused)?,
            heartbeat_s: None,
            limit_s: None,
            orders: Vec::new(),
        };
        self.leave(&orders_key(&job), &nothing)?;
        let mut answer = None;
        let submitted = self.submit_array(&array, &Resources::default(), 1);
        let mut n_looks = if submitted.is_ok() { TRIAL_LOOKS } else { 0 };
        while answer.is_none() && n_looks > 0 {
            thread::sleep(POLL_PERIOD);
            n_looks -= 1;
            answer = self.lake.message(&here_key(&job)).map_err(failed)?;
        }
        if answer.is_none() {
            let _gone = ask(&self.cancellation(&array), "");
        }
        for key in [orders_key(&job), here_key(&job)] {
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

    /// Submits the units at these positions.
    fn submit(
        &self,
        wave: &Wave,
        driver: &str,
        rest: &[usize],
        arrays: &mut Vec<Array>,
    ) -> Result<(), Failure> {
        if rest.is_empty() {
            return Ok(());
        }
        let n_in_job = match wave.took_s {
            Some(took_s) => {
                let has_limit = wave.resources().time_min.is_some();
                units_of_job(took_s, if has_limit { 0 } else { rest.len() })
            }
            None => rest.len().div_ceil(JOBS_OF_UNKNOWN_TIME),
        };
        let jobs: Vec<&[usize]> = rest.chunks(n_in_job).collect();
        for jobs in jobs.chunks(self.limit()) {
            let mut array = Array {
                name: unique_name().map_err(|err| self.refused(&err))?,
                id: None,
                on: self.name.clone(),
                driver: driver.to_owned(),
                jobs: Vec::with_capacity(jobs.len()),
            };
            let mut all_orders = Vec::with_capacity(jobs.len());
            for job in jobs {
                let orders = job.iter().map(|idx| wave.order(*idx));
                let orders: Vec<Order> = orders.collect::<Result<_, _>>()?;
                array
                    .jobs
                    .push(orders.iter().map(|order| order.fingerprint).collect());
                all_orders.push(orders);
            }
            // First, so that whoever comes after a killed run finds what it left.
            let wave_key = key(wave, &array.name);
            self.leave(&wave_key, &array)?;
            for (idx, orders) in all_orders.into_iter().enumerate() {
                let folder = env::current_dir().map_err(|err| self.refused(&err))?;
                let key = orders_key(&format!("{}/{idx}", array.name));
                // Several come in the time in which one must.
                let heartbeat_s = Some((self.table.heartbeat_timeout_s / 5).max(1));
                let job = JobOrders {
                    folder,
                    heartbeat_s,
                    limit_s: limit_s(wave.resources(), n_in_job),
                    orders,
                };
                self.leave(&key, &job)?;
            }
            // Whatever comes now, its jobs are cancelled by their name.
            out(|out| out.insert(array.name.clone(), self.cancellation(&array)));
            let submitted = self.submit_array(&array, wave.resources(), n_in_job);
            let noted = submitted.and_then(|id| {
                array.id = id;
                out(|out| out.insert(array.name.clone(), self.cancellation(&array)));
                self.leave(&wave_key, &array)
            });
            arrays.push(array);
            noted?;
        }
        Ok(())
    }

    /// Returns the values of the names in the table's words and script, for an array.
    fn values<'r>(
        &self,
        array: &Array,
        resources: &'r Resources,
        n_in_job: usize,
    ) -> Result<Values, Failure> {
        let cores = resources.cores.unwrap_or(1);
        let program = match &self.table.program {
            Some(program) => program.clone(),
            None => env::current_exe()
                .map_err(|err| self.refused(&err))?
                .display()
                .to_string(),
        };
        let time_min = limit_s(resources, n_in_job).map(|it| it / 60);
        let environment = resources.environment.join("\n");
        let environment = (!environment.is_empty()).then_some(&environment);
        let some = |text: &'r Option<String>| text.as_ref().map(|it| it as &dyn ToString);
        Ok(values_of(array)
            .with_some("partition", some(&resources.partition))
            .with_some("account", some(&resources.account))
            .with_some("qos", some(&resources.qos))
            .with_some("constraint", some(&resources.constraint))
            .with_some("gres", some(&resources.gres))
            .with_some("environment", environment.map(|it| it as _))
            .with("n", &array.jobs.len())
            .with("last", &array.jobs.len().saturating_sub(1))
            .with("logs", &self.logs.display())
            .with("cores", &cores)
            .with_some("memory_gb", resources.memory_gb.as_ref().map(|it| it as _))
            .with_some("gpus", resources.gpus.as_ref().map(|it| it as _))
            .with_some("time_min", time_min.as_ref().map(|it| it as _))
            .with("depot", &quoted(&self.depot))
            .with(
                "worker",
                &format!("{} unit --jobs {cores}", quoted(&program)),
            ))
    }

    /// Asks whether jobs with these resources could be submitted, if the scheduler answers such a question.
    pub(crate) fn test(&self, resources: &Resources) -> Result<(), Failure> {
        if self.table.test.is_empty() {
            return Ok(());
        }
        let array = Array {
            name: unique_name().map_err(|err| self.refused(&err))?,
            id: None,
            on: self.name.clone(),
            driver: String::new(),
            jobs: vec![Vec::new()],
        };
        let values = self.values(&array, resources, 1)?;
        let mut words = self.table.submission(&values);
        words.splice(1..1, self.table.test.iter().cloned());
        let asked = ask(&words, &values.lines(&self.table.script));
        asked.map(drop).map_err(|err| Failure::Executor {
            message: format!(
                "`{}` refuses jobs with {}: {err}",
                self.name,
                described(resources)
            ),
            hint: Some(
                "correct `resources` of the stage, or what the executor's table adds".to_owned(),
            ),
        })
    }

    /// Submits an array. A scheduler that does not answer is waited for; one that answers its queries and
    /// still fails to take the array refuses it.
    fn submit_array(
        &self,
        array: &Array,
        resources: &Resources,
        n_in_job: usize,
    ) -> Result<Option<String>, Failure> {
        let values = self.values(array, resources, n_in_job)?;
        let (words, script) = (
            self.table.submission(&values),
            values.lines(&self.table.script),
        );
        let mut n_failed = 0;
        loop {
            let err = match ask(&words, &script) {
                Ok(said) => return Ok(self.table.id_in(&said)),
                Err(err) => err,
            };
            let said = err.to_string();
            if err.kind() == io::ErrorKind::NotFound || self.refuses(&said) {
                return Err(self.refused(&err));
            }
            // Its answer may have been lost, or it may have gone in the middle of it.
            for _ in 0..SUBMITTED_LOOKS {
                thread::sleep(POLL_PERIOD);
                let queue = self.look_patiently(std::slice::from_ref(array))?;
                if queue.keys().any(|(name, _)| *name == array.name) {
                    return Ok(None);
                }
            }
            n_failed += 1;
            if n_failed == SUBMISSIONS {
                return Err(self.refused(&err));
            }
        }
    }

    /// Whether a submission that was answered so would be refused again.
    fn refuses(&self, said: &str) -> bool {
        let mut words = self.table.refused.iter();
        words.any(|words| said.contains(words))
    }

    fn cancellation(&self, array: &Array) -> Vec<String> {
        values_of(array).words(&self.table.cancel)
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
            &self.table,
            &ask(&values.words(&self.table.query), "")?,
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
                    report::line(&format!("wait   {} does not answer: {err}", self.name));
                }
                Err(_) => {}
            }
            n_looks += 1;
            thread::sleep(POLL_PERIOD);
        }
    }

    /// Number of jobs that one array may have.
    fn limit(&self) -> usize {
        let said = ask(&self.table.limit, "").ok();
        let limit = said.and_then(|said| self.table.limit_in(&said));
        // The number is that of the first index that is too large.
        limit.map_or(DEFAULT_ARRAY_JOBS, |limit| limit.max(1))
    }

    fn log(&self, array: &Array, job: usize) -> String {
        let values = values_of(array).with("index", &job);
        let name = values.words(std::slice::from_ref(&self.table.log)).concat();
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

/// Returns the seconds that a job of this many units has, if its units have a time limit.
fn limit_s(resources: &Resources, n_in_job: usize) -> Option<u64> {
    let time_min = u64::from(resources.time_min?);
    // More minutes than a scheduler counts are no limit.
    let time_min = time_min
        .saturating_mul(n_in_job as u64)
        .min(u64::from(u32::MAX));
    Some(time_min * 60)
}

/// The resources in the words of a pipeline file.
fn described(resources: &Resources) -> String {
    let number = |key: &str, value: Option<u32>| value.map(|value| format!("`{key} = {value}`"));
    let text = |key: &str, value: &Option<String>| {
        value.as_ref().map(|value| format!("`{key} = \"{value}\"`"))
    };
    let all = [
        number("cores", resources.cores),
        number("memory_gb", resources.memory_gb),
        number("gpus", resources.gpus),
        number("time_min", resources.time_min),
        text("partition", &resources.partition),
        text("account", &resources.account),
        text("qos", &resources.qos),
        text("constraint", &resources.constraint),
        text("gres", &resources.gres),
    ];
    let named: Vec<String> = all.into_iter().flatten().collect();
    if named.is_empty() {
        "nothing in particular".to_owned()
    } else {
        named.join(", ")
    }
}

/// Returns the number of units per job for units of this duration: more where there would be too many jobs for
/// `n_units`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a number between 1 and 100,000"
)]
fn units_of_job(took_s: f64, n_units: usize) -> usize {
    let n_in_job = (JOB_S / took_s).clamp(1.0, 1e5) as usize;
    n_in_job.max(n_units.div_ceil(MOST_JOBS))
}

/// A name that no other array has.
fn unique_name() -> io::Result<String> {
    let random = fs::read_to_string("/proc/sys/kernel/random/uuid")?;
    let digits: String = random
        .chars()
        .filter(char::is_ascii_hexdigit)
        .take(12)
        .collect();
    Ok(format!("pl{digits}"))
}

/// A word as a shell reads it; plain words, and `~`, stay as they are.
pub(crate) fn for_shell(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./~:=@%+,-".contains(c);
    if word.chars().all(is_plain) {
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
    fn short_units_share_a_job_and_long_ones_have_their_own() {
        assert_eq!(units_of_job(0.01, 4500), 4500);
        assert_eq!(units_of_job(10.0, 4500), 4);
        assert_eq!(units_of_job(3600.0, 4000), 1);
        assert_eq!(units_of_job(3600.0, 100_000), 25, "4,000 jobs");
        assert_eq!(units_of_job(0.0, 4500), 100_000);
    }

    #[test]
    fn names_are_never_given_twice_and_words_survive_a_shell() {
        assert_ne!(unique_name().unwrap(), unique_name().unwrap());
        assert_eq!(quoted("it's"), "'it'\\''s'");
    }
}
