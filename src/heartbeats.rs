//! Heartbeats: what a process leaves now and then, by which others know that it is alive.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::Mutex,
    time::Duration,
};

use clock::Condvar;

/// Calls `beat` once in each period while `work` lasts, however it ends.
pub(crate) fn during<R>(
    period: Duration,
    mut beat: impl FnMut() + Send,
    work: impl FnOnce() -> R,
) -> R {
    let (is_over, changed) = (Mutex::new(false), Condvar::default());
    let beats = || {
        let mut next = clock::now() + period;
        let mut over = clock::lock(&is_over);
        // Held from the look at it to the wait: an end between them would wake nobody.
        while !*over {
            let left = next.saturating_duration_since(clock::now());
            if left.is_zero() {
                drop(over);
                beat();
                next = clock::now() + period;
                over = clock::lock(&is_over);
            } else {
                over = changed.wait_timeout(over, &is_over, left);
            }
        }
    };
    let done = clock::beside(beats, || {
        let done = catch_unwind(AssertUnwindSafe(work));
        *clock::lock(&is_over) = true;
        changed.notify_all();
        done
    });
    done.unwrap_or_else(|panic| resume_unwind(panic))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

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

    #[test]
    fn work_that_ends_at_once_does_not_wait_for_a_period() {
        let (seen, ended) = mpsc::channel();
        std::thread::spawn(move || {
            for round in 0..20_000 {
                // It ends at any time in the first steps of the other thread.
                let work = || (0..round % 5_000).for_each(|_| std::hint::spin_loop());
                during(Duration::from_hours(1), || {}, work);
            }
            seen.send(()).unwrap();
        });
        assert_eq!(ended.recv_timeout(Duration::from_mins(5)), Ok(()));
    }
}
