//! Running the units of an output on several threads.

use std::{
    ops::ControlFlow,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
};

/// Runs `work` on the numbers below `count` on up to `n_workers` threads. None is started after one
/// that breaks off.
///
/// These threads are not the pool in which stages compute: a thread that holds a unit's lock must
/// not start another unit before it is done.
pub(crate) fn each(count: usize, n_workers: usize, work: impl Fn(usize) -> ControlFlow<()> + Sync) {
    let next = AtomicUsize::new(0);
    let is_over = AtomicBool::new(false);
    let go_through = || {
        while !is_over.load(Ordering::Relaxed) {
            let idx = next.fetch_add(1, Ordering::Relaxed);
            if idx >= count {
                return;
            }
            if work(idx).is_break() {
                is_over.store(true, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..n_workers.min(count) {
            scope.spawn(go_through);
        }
    });
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, sync::Mutex};

    use super::*;

    #[test]
    fn every_number_is_worked_on_once() {
        let worked = Mutex::new(Vec::new());
        each(100, 4, |idx| {
            worked.lock().unwrap().push(idx);
            ControlFlow::Continue(())
        });
        let worked = worked.into_inner().unwrap();
        assert_eq!(worked.len(), 100);
        assert_eq!(worked.iter().collect::<BTreeSet<_>>().len(), 100);
    }

    #[test]
    fn nothing_is_started_after_a_break() {
        let worked = Mutex::new(Vec::new());
        each(100, 1, |idx| {
            worked.lock().unwrap().push(idx);
            if idx < 3 {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        });
        assert_eq!(worked.into_inner().unwrap(), [0, 1, 2, 3]);
    }
}
