//! How often a request to a depot is made again, and for how long.

use std::time::{Duration, Instant};

/// Silence after which a request counts as failed, the first time.
pub(crate) const ANSWER_TIMEOUT: Duration = Duration::from_secs(4);

/// The same after many tries: a file system that works may take a minute under load.
const LONGEST_ANSWER: Duration = Duration::from_mins(1);

/// Pauses between tries: the first, and the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// Age from which an outage is told.
pub(crate) const SAID_AFTER: Duration = Duration::from_secs(1);

/// For how long a request that fails is made again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Patience {
    /// Not again: another like it follows, as after a heartbeat.
    Once,
    /// Not again, and after failures nothing is asked for a while: one can do without the answers.
    Casual,
    /// For this long; then the depot is offline.
    For(Duration),
}

impl Patience {
    /// Time that a process may lose to a depot without which it goes on.
    pub const BRIEF: Self = Self::For(Duration::from_secs(5));

    /// Until the process ends.
    pub const ENDLESS: Self = Self::For(Duration::from_hours(365 * 24));

    /// Number of the first pause of a casual link.
    pub(crate) const CASUAL_FROM: u32 = 4;

    /// Time left for a request that began then, if it is made again at all.
    pub(crate) fn left(self, began: Instant) -> Option<Duration> {
        match self {
            Self::Once | Self::Casual => None,
            Self::For(longest) => Some(longest.saturating_sub(clock::since(began))),
        }
    }
}

/// A time in which a depot does not answer, or answers with errors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outage {
    /// Time since the request was first made.
    pub lasted: Duration,
    /// Why, with all causes; `None` when it is over.
    pub why: Option<String>,
    /// Time for which requests are still made again.
    pub left: Duration,
}

/// Time to wait for an answer after this many failures.
pub(crate) fn timeout(n_failed: u32, left: Duration) -> Duration {
    let grown = ANSWER_TIMEOUT.saturating_mul(1 << n_failed.min(8));
    grown
        .min(LONGEST_ANSWER)
        .min(left)
        .max(Duration::from_secs(1))
}

/// Pause after this many failures.
pub(crate) fn pause(n_failed: u32) -> Duration {
    let grown = FIRST_PAUSE.saturating_mul(1 << n_failed.saturating_sub(1).min(16));
    grown.min(LONGEST_PAUSE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_and_time_outs_grow_to_a_limit() {
        let pauses: Vec<u128> = (1..12).map(|n| pause(n).as_millis()).collect();
        assert_eq!(pauses[..4], [100, 200, 400, 800]);
        assert_eq!(pauses.last(), Some(&30_000));
        let long = Duration::from_hours(1);
        let waits: Vec<u64> = (0..6).map(|n| timeout(n, long).as_secs()).collect();
        assert_eq!(waits, [4, 8, 16, 32, 60, 60]);
        assert_eq!(timeout(9, Duration::from_secs(2)).as_secs(), 2);
    }
}
