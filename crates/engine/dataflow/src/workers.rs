//! Running the units of an output on several threads.

use std::{
    collections::VecDeque,
    hash::{DefaultHasher, Hash, Hasher},
    ops::ControlFlow,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Duration,
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
    clock::all(n_workers.min(count), go_through);
}

/// Pause before a number that another machine works on is tried again.
const PAUSE: Duration = Duration::from_millis(500);

/// Does the same in an order that is this process's own; a number for which `work` returns `None` is another machine's
/// now, and comes again when no others are left.
pub(crate) fn each_by_turns(
    count: usize,
    n_workers: usize,
    work: impl Fn(usize) -> Option<ControlFlow<()>> + Sync,
) {
    let mut own: Vec<usize> = (0..count).collect();
    let own_order = clock::random();
    own.sort_by_cached_key(|idx| {
        let mut hasher = DefaultHasher::new();
        (own_order, idx).hash(&mut hasher);
        hasher.finish()
    });
    let (own, others) = (Mutex::new(own), Mutex::new(VecDeque::<usize>::new()));
    let take = || own.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let waiting = || others.lock().unwrap_or_else(PoisonError::into_inner);
    let is_over = AtomicBool::new(false);
    let go_through = || {
        while !is_over.load(Ordering::Relaxed) {
            let idx = if let Some(idx) = take() {
                idx
            } else {
                let Some(idx) = waiting().pop_front() else {
                    return;
                };
                clock::sleep(PAUSE);
                idx
            };
            match work(idx) {
                Some(done) if done.is_break() => is_over.store(true, Ordering::Relaxed),
                Some(_) => {}
                None => waiting().push_back(idx),
            }
        }
    };
    clock::all(n_workers.min(count), go_through);
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

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
    fn what_another_machine_works_on_comes_last() {
        let worked = Mutex::new(Vec::new());
        each_by_turns(20, 3, |idx| {
            let mut worked = worked.lock().unwrap();
            // Those below 3 are another's until all others are done.
            if idx < 3 && worked.len() < 17 {
                return None;
            }
            worked.push(idx);
            Some(ControlFlow::Continue(()))
        });
        let worked = worked.into_inner().unwrap();
        assert_eq!(worked.iter().collect::<BTreeSet<_>>().len(), 20);
        assert!(worked[17..].iter().all(|idx| *idx < 3), "{worked:?}");
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
