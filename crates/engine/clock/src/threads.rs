//! Threads of a process.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use crate::simulated::{Thread, enter, here};

/// Runs `work` in a thread of its own, as long as this process lives.
pub fn spawn(work: impl FnOnce() + Send + 'static) {
    match here() {
        None => {
            thread::spawn(work);
        }
        Some(here) => here.sibling().start(work),
    }
}

/// Runs `work` in `n` threads, and returns when it has ended in all of them. A single one is this thread.
///
/// # Panics
///
/// Panics if it panics in one of them.
pub fn all(n: usize, work: impl Fn() + Sync) {
    if n == 1 {
        work();
    } else if n > 1 {
        beside_all(n - 1, &work, &work);
    }
}

/// Runs `other` in a thread of its own and `work` in this one, and returns when both have ended.
///
/// # Panics
///
/// Panics if one of them panics.
pub fn beside<R>(other: impl FnOnce() + Send, work: impl FnOnce() -> R) -> R {
    let other = Mutex::new(Some(other));
    let once = || {
        let other = other.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(other) = other {
            other();
        }
    };
    beside_all(1, &once, work)
}

fn beside_all<R>(n: usize, others: &(impl Fn() + Sync), work: impl FnOnce() -> R) -> R {
    let Some(here) = here() else {
        return thread::scope(|scope| {
            for _ in 0..n {
                scope.spawn(others);
            }
            work()
        });
    };
    let panics: Mutex<Vec<Box<dyn Any + Send>>> = Mutex::default();
    let siblings: Vec<Arc<Thread>> = (0..n).map(|_| here.sibling()).collect();
    let done = thread::scope(|scope| {
        for sibling in &siblings {
            scope.spawn(|| {
                let ended = sibling.run(others);
                let mut panics = panics.lock().unwrap_or_else(PoisonError::into_inner);
                panics.extend(ended.err());
            });
        }
        let done = catch_unwind(AssertUnwindSafe(work));
        // The scope would wait for them without giving them a turn.
        here.join(&siblings);
        done
    });
    let panics = panics.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some(panic) = panics.into_iter().next().filter(|_| done.is_ok()) {
        resume_unwind(panic);
    }
    done.unwrap_or_else(|panic| resume_unwind(panic))
}

/// Returns `work` that counts as work of this thread wherever it runs, while this thread waits for it.
pub fn carry<R>(work: impl FnOnce() -> R) -> impl FnOnce() -> R {
    let here = here();
    move || enter(here, work)
}
