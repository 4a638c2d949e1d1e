//! Seconds of processor time of a computation, whatever else the machine does.
//!
//! ```
//! let (sum, seconds) = cpu_time::measured(|| (1..=1000_u64).sum::<u64>());
//! assert_eq!(sum, 500_500);
//! assert!(seconds >= 0.0);
//! ```
//!
//! A metric may have them; an artifact must not, for equal arguments give equal bytes.

use rustix::time::{ClockId, clock_gettime};

/// Runs a computation on this thread; returns what it returns, and the processor time in seconds that this thread
/// took for it.
pub fn measured<T>(computation: impl FnOnce() -> T) -> (T, f64) {
    let before_s = thread_s();
    let result = computation();
    (result, (thread_s() - before_s).max(0.0))
}

/// Returns the processor time in seconds that this thread has taken since it began.
pub fn thread_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use std::{hint::black_box, thread, time::Duration};

    use super::*;

    #[test]
    fn sleeping_costs_nothing_and_computing_does() {
        let ((), slept_s) = measured(|| thread::sleep(Duration::from_millis(200)));
        let (_, computed_s) = measured(|| (0..30_000_000_u64).fold(1, |a, b| black_box(a ^ b)));
        assert!(slept_s < 0.1, "{slept_s} s");
        assert!(computed_s > 0.0 && computed_s > slept_s, "{computed_s} s");
    }
}
