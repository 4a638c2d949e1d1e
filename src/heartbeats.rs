//! Heartbeats: what a process leaves now and then, by which others know that it is alive.

use std::{
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

/// Calls `beat` once in each period while `work` lasts, however it ends.
pub(crate) fn during<R>(
    period: Duration,
    mut beat: impl FnMut() + Send,
    work: impl FnOnce() -> R,
) -> R {
    let (over, beating) = mpsc::channel::<()>();
    thread::scope(|scope| {
        // Moved into this closure, so that it is dropped before the scope waits for the thread.
        let over = over;
        scope.spawn(move || {
            while beating.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                beat();
            }
        });
        let done = work();
        drop(over);
        done
    })
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    #[test]
    fn work_that_panics_ends_its_heartbeats() {
        let work = || during(Duration::from_millis(1), || {}, || panic!("in the work"));
        let ended: Result<(), _> = catch_unwind(AssertUnwindSafe(work));
        assert!(ended.is_err());
    }

    #[test]
    fn heartbeats_come_while_the_work_lasts() {
        let (seen, beats) = mpsc::channel();
        let beat = move || seen.send(()).unwrap_or_default();
        let got = during(Duration::from_millis(1), beat, || {
            beats.recv().and_then(|()| beats.recv())
        });
        assert_eq!(got, Ok(()));
    }
}
