//! Runs that look after jobs, of any machine. Two may want the same units at once: the one whose jobs make
//! them is waited for by the other, which takes the jobs over if the first has died.

use std::{
    fs,
    time::{Duration, Instant},
};

use dataflow::Failure;
use serde::{Deserialize, Serialize};

use super::{Batch, POLL_PERIOD, failed};
use crate::heartbeats;

/// Time between two heartbeats of a run.
const PERIOD: Duration = Duration::from_secs(10);

/// Time without a new heartbeat after which a run counts as dead, by the clock of the machine that waits.
pub(super) const TIMEOUT: Duration = Duration::from_secs(45);

/// A heartbeat.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Heartbeat {
    pub(super) host: String,
    pub(super) process: u32,
    /// Start time of the process, which distinguishes it from a later one with the same id.
    start: String,
    /// Number of the heartbeat.
    n: u64,
}

impl Heartbeat {
    fn of_this_process() -> Self {
        let process = std::process::id();
        Self {
            host: lake::host(),
            process,
            start: start(process).unwrap_or_default(),
            n: 0,
        }
    }

    /// Whether its process is one of this machine that has ended.
    fn has_ended(&self) -> bool {
        self.host == lake::host() && start(self.process).as_ref() != Some(&self.start)
    }
}

/// Returns the start time of a process of this machine, in ticks since this boot, and the boot.
fn start(process: u32) -> Option<String> {
    // The name, in parentheses, may contain blanks; the 22nd field is the 20th after it.
    const FIELD: usize = 19;
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = fields.split_whitespace().nth(FIELD)?;
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
    Some(format!("{ticks} {}", boot.trim()))
}

/// Key of the heartbeats of a run.
fn key(driver: &str) -> String {
    format!("drivers/{driver}")
}

impl Batch<'_> {
    /// Leaves heartbeats of `driver` while `work` lasts.
    pub(super) fn alive_during<R>(
        &self,
        driver: &str,
        work: impl FnOnce() -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        let key = key(driver);
        let mut heartbeat = Heartbeat::of_this_process();
        self.leave(&key, &heartbeat)?;
        let beat = || {
            heartbeat.n += 1;
            // One that is missed is followed by others.
            let bytes = serde_json::to_vec(&heartbeat);
            let _left = bytes.map(|bytes| self.lake.leave_heartbeat(&key, &bytes));
        };
        let done = heartbeats::during(PERIOD, beat, work);
        // Files left in a depot that is down are removed by its garbage collection.
        let _gone = self.lake.remove_message(&key);
        done
    }

    /// Whether a run may look after its jobs still: it has left a heartbeat, and is not known to have ended.
    pub(super) fn may_live(&self, driver: &str) -> Result<bool, Failure> {
        let found = self.lake.message(&key(driver)).map_err(failed)?;
        let heartbeat: Option<Heartbeat> =
            found.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        Ok(heartbeat.is_some_and(|heartbeat| !heartbeat.has_ended()))
    }

    /// Removes the heartbeat of a run that has ended.
    pub(super) fn remove_heartbeat(&self, driver: &str) -> Result<(), Failure> {
        self.lake.remove_message(&key(driver)).map_err(failed)
    }

    /// Waits while a run looks after its jobs; returns whether it was alive. `waiting` is called before the first
    /// wait; a run on another machine is known to be alive or dead only later.
    pub(super) fn wait_for(
        &self,
        driver: &str,
        waiting: impl FnOnce(&Heartbeat),
    ) -> Result<bool, Failure> {
        let key = key(driver);
        let mut waiting = Some(waiting);
        let mut seen: Option<(Heartbeat, Instant)> = None;
        let mut has_waited = false;
        loop {
            let found = self.lake.message(&key).map_err(failed)?;
            let heartbeat: Option<Heartbeat> =
                found.and_then(|bytes| serde_json::from_slice(&bytes).ok());
            let Some(heartbeat) = heartbeat.filter(|heartbeat| !heartbeat.has_ended()) else {
                // One that was seen was alive until now.
                has_waited |= seen.is_some();
                break;
            };
            match &mut seen {
                Some((last, at)) if *last == heartbeat => {
                    // While the depot is down nobody is heard.
                    let untroubled = self.lake.time_since_failure();
                    let is_heard = untroubled.is_some_and(|since| since <= TIMEOUT);
                    if clock::since(*at) > TIMEOUT && !is_heard {
                        break;
                    }
                }
                known => {
                    has_waited |= known.is_some() || heartbeat.host == lake::host();
                    if let Some(waiting) = waiting.take() {
                        waiting(&heartbeat);
                    }
                    *known = Some((heartbeat, clock::now()));
                }
            }
            clock::sleep(POLL_PERIOD);
        }
        self.lake.remove_message(&key).map_err(failed)?;
        Ok(has_waited)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_told_from_a_later_one_of_its_number() {
        let mut heartbeat = Heartbeat::of_this_process();
        assert!(!heartbeat.start.is_empty() && !heartbeat.has_ended());
        heartbeat.start.push('0');
        assert!(heartbeat.has_ended());
        heartbeat.host.push_str("-other");
        assert!(
            !heartbeat.has_ended(),
            "nothing is known of another machine"
        );
    }
}
