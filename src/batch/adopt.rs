//! Arrays of jobs that other runs have submitted: waited for, or taken over.

use std::{
    collections::{BTreeSet, HashMap},
    time::Duration,
};

use dataflow::{Digest, Failure, OnOutcome, Store, UnitOutcome, Wave};

use super::{Array, Batch, drivers::TIMEOUT, failed, key, out, queue::JobState, unique_name};
use crate::{label::Label, report};

/// Longest pause of a run that wanted the same units as another at the same time, in milliseconds.
const LONGEST_CLAIM_PAUSE_MS: u64 = 4_000;

impl Batch<'_> {
    /// Finds arrays that make units of this output and waits for the runs that look after them; takes over,
    /// of those that have died, the arrays with the jobs that are not over.
    pub(super) fn adopt(
        &self,
        wave: &Wave,
        driver: &str,
        open: &mut HashMap<Digest, usize>,
        on_outcome: &OnOutcome,
    ) -> Result<Vec<Array>, Failure> {
        let mut arrays = self.arrays_in_depot(wave, open)?;
        while self.wait_for_drivers(wave, &arrays)? {
            for digest in open.keys().copied().collect::<Vec<_>>() {
                let made = self.lake.arrived(&digest).map_err(Failure::Store)?;
                if made.is_some()
                    && let Some(idx) = open.remove(&digest)
                {
                    on_outcome(idx, UnitOutcome::Done { made_now: false });
                }
            }
            arrays = self.arrays_in_depot(wave, open)?;
        }
        if arrays.is_empty() {
            return Ok(arrays);
        }
        let queue = self.look_patiently(&arrays)?;
        let (mut kept, mut gone) = (Vec::new(), Vec::new());
        for mut array in arrays {
            let name = array.name.clone();
            for (idx, job) in array.jobs.iter_mut().enumerate() {
                let state = queue.get(&(name.clone(), idx));
                if !matches!(state, Some(JobState::Waiting(_) | JobState::Running(_))) {
                    job.clear();
                }
            }
            let is_out = array.jobs.iter().any(|job| !job.is_empty());
            if is_out { &mut kept } else { &mut gone }.push(array);
        }
        for array in &gone {
            self.forget(wave, array)?;
        }
        for array in &mut kept {
            driver.clone_into(&mut array.driver);
            self.leave(&key(wave, &array.name), array)?;
            out(|out| out.insert(array.name.clone(), self.cancellation(array)));
            report::line(
                Label::Adopt,
                format!("{}: array {} goes on", wave.output(), array.name),
            );
        }
        Ok(kept)
    }

    /// Removes what killed runs of a pipeline have left in the depot for arrays that are over: their units were made,
    /// and nobody asks for them any more.
    pub(crate) fn tidy(&self, pipeline: &str) -> Result<(), Failure> {
        let mut arrays = Vec::new();
        for key in self
            .lake
            .messages(&format!("waves/{pipeline}"))
            .map_err(failed)?
        {
            let found = self.lake.message(&key).map_err(failed)?;
            let array: Option<Array> = found.and_then(|it| serde_json::from_slice(&it).ok());
            let Some(array) = array.filter(|array| array.on == self.name) else {
                continue;
            };
            if !self.may_live(&array.driver)? {
                arrays.push((key, array));
            }
        }
        if arrays.is_empty() {
            return Ok(());
        }
        let (keys, arrays): (Vec<String>, Vec<Array>) = arrays.into_iter().unzip();
        let queue = self.look_patiently(&arrays)?;
        for (key, array) in keys.into_iter().zip(arrays) {
            let is_out = |((name, _), state): (&(String, usize), &JobState)| {
                *name == array.name && !matches!(state, JobState::Over(_))
            };
            if !queue.iter().any(is_out) {
                self.forget_at(key, &array)?;
                self.remove_heartbeat(&array.driver)?;
            }
        }
        Ok(())
    }

    /// Notes that units are about to be submitted; returns the note's key. `None` where another run has done the same
    /// meanwhile: both take their notes back, and begin again after a time of their own.
    pub(super) fn claim(
        &self,
        wave: &Wave,
        driver: &str,
        rest: &HashMap<Digest, usize>,
    ) -> Result<Option<String>, Failure> {
        let mut units: Vec<Digest> = rest.keys().copied().collect();
        units.sort_unstable();
        // An array of which the scheduler knows no job.
        let claim = Array {
            name: unique_name(),
            id: None,
            on: self.name.clone(),
            driver: driver.to_owned(),
            jobs: vec![units],
        };
        let key = key(wave, &claim.name);
        self.leave(&key, &claim)?;
        let all = self.arrays_in_depot(wave, rest)?;
        if all.iter().all(|array| array.driver == driver) {
            return Ok(Some(key));
        }
        self.lake.remove_message(&key).map_err(failed)?;
        clock::sleep(Duration::from_millis(
            clock::random() % LONGEST_CLAIM_PAUSE_MS,
        ));
        Ok(None)
    }

    /// Whether arrays that make units of this output are in the depot.
    pub(super) fn has_arrays(&self, wave: &Wave) -> bool {
        let below = format!("waves/{}/{}", wave.pipeline(), wave.output());
        // A depot that cannot be asked has none to take over.
        self.lake
            .messages(&below)
            .is_ok_and(|keys| !keys.is_empty())
    }

    /// Lists the arrays in the depot that make units of this output.
    fn arrays_in_depot(
        &self,
        wave: &Wave,
        open: &HashMap<Digest, usize>,
    ) -> Result<Vec<Array>, Failure> {
        let below = format!("waves/{}/{}", wave.pipeline(), wave.output());
        let mut arrays = Vec::new();
        for key in self.lake.messages(&below).map_err(failed)? {
            let found = self.lake.message(&key).map_err(failed)?;
            let array: Option<Array> = found.and_then(|it| serde_json::from_slice(&it).ok());
            // Others make units of other values, or of another run.
            let is_of_wave = |array: &Array| {
                let mut units = array.jobs.iter().flatten();
                array.on == self.name && units.any(|unit| open.contains_key(unit))
            };
            arrays.extend(array.filter(is_of_wave));
        }
        Ok(arrays)
    }

    /// Waits for each run that looks after one of these arrays; returns whether one of them was alive.
    fn wait_for_drivers(&self, wave: &Wave, arrays: &[Array]) -> Result<bool, Failure> {
        let drivers: BTreeSet<&str> = arrays.iter().map(|it| it.driver.as_str()).collect();
        let mut have_waited = false;
        for driver in drivers {
            have_waited |= self.wait_for(driver, |heartbeat| {
                let timeout_s = TIMEOUT.as_secs();
                let mut takeover = format!("; taken over after {timeout_s} s without a heartbeat");
                if heartbeat.host == lake::host() {
                    // Its end is seen at once.
                    takeover.clear();
                }
                report::line(
                    Label::Wait,
                    format!(
                        "{}: made by jobs of another run, process {} on `{}`{takeover}",
                        wave.output(),
                        heartbeat.process,
                        heartbeat.host
                    ),
                );
            })?;
        }
        Ok(have_waited)
    }
}
