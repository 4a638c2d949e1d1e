//! Runs that look after jobs, of any machine. Two may want the same units at once: the one whose jobs make
//! them is waited for by the other, which takes the jobs over if the first has died.

use std::{
    fs,
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::{Duration, Instant},
};

use dataflow::Failure;
use serde::{Deserialize, Serialize};

use super::{Batch, EVERY, failed};

/// Time between two signs of life of a run.
const BEAT: Duration = Duration::from_secs(10);

/// Time without a new sign after which a run counts as dead. Both times are measured on one machine.
const SILENCE: Duration = Duration::from_secs(45);

/// A sign of life.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Sign {
    pub(super) host: String,
    pub(super) process: u32,
    /// What tells this process from a later one of the same number.
    start: String,
    /// Number of the sign.
    n: u64,
}

impl Sign {
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
    fn is_of_the_dead(&self) -> bool {
        self.host == lake::host() && start(self.process).as_ref() != Some(&self.start)
    }
}

/// When a process of this machine was started, in ticks since this boot, and the boot.
fn start(process: u32) -> Option<String> {
    // The name, in parentheses, may contain blanks; the 22nd field is the 20th after it.
    const FIELD: usize = 19;
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = fields.split_whitespace().nth(FIELD)?;
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
    Some(format!("{ticks} {}", boot.trim()))
}

/// Key of the signs of a run.
fn key(driver: &str) -> String {
    format!("drivers/{driver}")
}

impl Batch<'_> {
    /// Leaves signs of life of `driver` while `work` lasts.
    pub(super) fn alive_during<R>(
        &self,
        driver: &str,
        work: impl FnOnce() -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        let key = key(driver);
        let mut sign = Sign::of_this_process();
        let mut leave = || {
            sign.n += 1;
            self.leave(&key, &sign)
        };
        leave()?;
        let (over, beating) = mpsc::channel::<()>();
        let done = thread::scope(|scope| {
            // Dropped before the scope ends, however the work ends.
            let over = over;
            scope.spawn(move || {
                while beating.recv_timeout(BEAT) == Err(RecvTimeoutError::Timeout) {
                    // One that is missed is followed by others.
                    let _left = leave();
                }
            });
            let done = work();
            drop(over);
            done
        });
        // What a depot that is down keeps, its garbage collection removes.
        let _gone = self.lake.remove_message(&key);
        done
    }

    /// Waits while a run looks after its jobs; returns `false` at once if it has ended. `waiting` is called
    /// once it is known to be alive.
    pub(super) fn wait_for(
        &self,
        driver: &str,
        waiting: impl FnOnce(&Sign),
    ) -> Result<bool, Failure> {
        let key = key(driver);
        let mut waiting = Some(waiting);
        let mut seen: Option<(Sign, Instant)> = None;
        let mut has_waited = false;
        loop {
            let found = self.lake.message(&key).map_err(failed)?;
            let sign: Option<Sign> = found.and_then(|bytes| serde_json::from_slice(&bytes).ok());
            let Some(sign) = sign.filter(|sign| !sign.is_of_the_dead()) else {
                break;
            };
            match &mut seen {
                Some((last, at)) if *last == sign => {
                    if at.elapsed() > SILENCE {
                        break;
                    }
                }
                known => {
                    let is_alive = known.is_some() || sign.host == lake::host();
                    *known = Some((sign.clone(), Instant::now()));
                    if is_alive && let Some(waiting) = waiting.take() {
                        has_waited = true;
                        waiting(&sign);
                    }
                }
            }
            thread::sleep(EVERY);
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
        let mut sign = Sign::of_this_process();
        assert!(!sign.start.is_empty() && !sign.is_of_the_dead());
        sign.start.push('0');
        assert!(sign.is_of_the_dead());
        sign.host.push_str("-other");
        assert!(
            !sign.is_of_the_dead(),
            "nothing is known of another machine"
        );
    }
}
