//! Submitting arrays of jobs, and asking whether they could be.

use std::{env, fs, io, slice};

use dataflow::{Failure, Resources, Wave, WorkItem};

use super::{
    Array, Batch, POLL_PERIOD, key, out, quoted, scheduler::Values, unique_name, values_of,
};
use crate::{
    invocation,
    jobs::{Job, job_key},
};

/// Times that an array is submitted before it counts as refused: a scheduler's message does not distinguish a
/// refusal from a shutdown, and a loaded controller loses several in a row.
const SUBMISSIONS: usize = 5;

/// Looks for the jobs of a submission that failed: they may be shown late.
const SUBMITTED_LOOKS: usize = 2;

/// Seconds that a job should take: what a scheduler costs, 0.1 to 0.5 s a job, does not count then.
const JOB_S: f64 = 45.0;

/// Number of jobs for units of unknown duration.
const JOBS_OF_UNKNOWN_TIME: usize = 64;

/// Most jobs for one output, unless its units have a time limit, which a job of many would multiply: a
/// controller of Slurm holds 10,000 by default, of all users.
const MOST_JOBS: usize = 4000;

impl Batch<'_> {
    /// Submits the units at these positions.
    pub(super) fn submit(
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
                name: unique_name(),
                id: None,
                on: self.name.clone(),
                driver: driver.to_owned(),
                jobs: Vec::with_capacity(jobs.len()),
            };
            let mut all_items = Vec::with_capacity(jobs.len());
            for job in jobs {
                let items = job.iter().map(|idx| wave.work_item(*idx));
                let items: Vec<WorkItem> = items.collect::<Result<_, _>>()?;
                array
                    .jobs
                    .push(items.iter().map(|item| item.fingerprint).collect());
                all_items.push(items);
            }
            // First, so that whoever comes after a killed run finds what it left.
            let wave_key = key(wave, &array.name);
            self.leave(&wave_key, &array)?;
            for (idx, items) in all_items.into_iter().enumerate() {
                let folder = env::current_dir().map_err(|err| self.refused(&err))?;
                let key = job_key(&format!("{}/{idx}", array.name));
                // Several come in the time in which one must.
                let heartbeat_s = Some((self.scheduler.heartbeat_timeout_s / 5).max(1));
                let job = Job {
                    folder,
                    heartbeat_s,
                    limit_s: limit_s(wave.resources(), n_in_job),
                    items,
                };
                self.leave(&key, &job)?;
            }
            self.make_logs(|| self.leave(&wave_key, &array))?;
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

    /// Makes the folder of logs in the depot, which `answers` has waited for: a folder that is away is not made anew
    /// in its place.
    pub(super) fn make_logs(
        &self,
        answers: impl Fn() -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        while let Err(err) = fs::create_dir(&self.logs) {
            match err.kind() {
                io::ErrorKind::AlreadyExists => break,
                io::ErrorKind::NotFound => answers()?,
                _ => return Err(self.refused(&err)),
            }
        }
        Ok(())
    }

    /// Returns the values of the names in the scheduler's words and script, for an array.
    fn values<'r>(
        &self,
        array: &Array,
        resources: &'r Resources,
        n_in_job: usize,
    ) -> Result<Values, Failure> {
        let cores = resources.cores.unwrap_or(1);
        let program = match &self.scheduler.program {
            Some(program) => program.clone(),
            None => invocation::executable()
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
        if self.scheduler.test.is_empty() {
            return Ok(());
        }
        let array = Array {
            name: unique_name(),
            id: None,
            on: self.name.clone(),
            driver: String::new(),
            jobs: vec![Vec::new()],
        };
        let values = self.values(&array, resources, 1)?;
        let mut words = self.scheduler.submission(&values);
        words.splice(1..1, self.scheduler.test.iter().cloned());
        let asked = (self.ask)(&words, &values.lines(&self.scheduler.script));
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
    pub(super) fn submit_array(
        &self,
        array: &Array,
        resources: &Resources,
        n_in_job: usize,
    ) -> Result<Option<String>, Failure> {
        let values = self.values(array, resources, n_in_job)?;
        let (words, script) = (
            self.scheduler.submission(&values),
            values.lines(&self.scheduler.script),
        );
        let mut n_failed = 0;
        loop {
            let err = match (self.ask)(&words, &script) {
                Ok(said) => return Ok(self.scheduler.id_in(&said)),
                Err(err) => err,
            };
            let said = err.to_string();
            if err.kind() == io::ErrorKind::NotFound || self.refuses(&said) {
                return Err(self.refused(&err));
            }
            // Its answer may have been lost, or it may have gone in the middle of it.
            for _ in 0..SUBMITTED_LOOKS {
                clock::sleep(POLL_PERIOD);
                let queue = self.look_patiently(slice::from_ref(array))?;
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
        let mut words = self.scheduler.refused.iter();
        words.any(|words| said.contains(words))
    }
}

/// Returns the seconds that a job of this many units has, if its units have a time limit.
pub(super) fn limit_s(resources: &Resources, n_in_job: usize) -> Option<u64> {
    let time_min = u64::from(resources.time_min?);
    // More minutes than a scheduler counts are no limit.
    let time_min = time_min
        .saturating_mul(n_in_job as u64)
        .min(u64::from(u32::MAX));
    Some(time_min * 60)
}

/// The resources in the words of a pipeline file.
pub(super) fn described(resources: &Resources) -> String {
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
}
