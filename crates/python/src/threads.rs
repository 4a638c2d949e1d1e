//! The module's own threads: those of the whole process would be gone in a process that `fork` made.

use std::{
    mem,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::failed;

static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Time after which a long computation looks for signals: a person's Ctrl-C acts at once.
const PATIENCE: Duration = Duration::from_millis(50);

const MORE_THREADS: &str = "raise the limit of threads (`ulimit -u`), or set `RAYON_NUM_THREADS`";

/// Whether a computation is to be given up.
pub(crate) struct Cancellation(AtomicBool);

impl Cancellation {
    /// Says whether the rest of the work is to be left.
    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Computes without the interpreter's lock, in as many threads as the process may use; what a signal's handler raises
/// ends the computation, as far as it asks.
///
/// # Errors
///
/// Fails with an exception if no threads can be started, and with that of a signal's handler.
pub(crate) fn in_threads<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce(&Cancellation) -> T + Send,
) -> PyResult<T> {
    // With the interpreter's lock, so that no other thread of Python forks meanwhile.
    let pool = pool().map_err(|err| failed(&err, Some(MORE_THREADS.to_owned())))?;
    let cancellation = Cancellation(AtomicBool::new(false));
    py.detach(|| {
        thread::scope(|scope| {
            let (send, receive) = mpsc::channel();
            let (pool, cancellation) = (&pool, &cancellation);
            let started = thread::Builder::new().spawn_scoped(scope, move || {
                let _none_waits = send.send(pool.install(|| compute(cancellation)));
            });
            started.map_err(|err| failed(&err, Some(MORE_THREADS.to_owned())))?;
            let mut raised = None;
            loop {
                match receive.recv_timeout(PATIENCE) {
                    Ok(computed) => return raised.map_or(Ok(computed), Err),
                    // The thread panicked: the scope passes that on.
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(
                            raised.unwrap_or_else(|| failed(&RecvTimeoutError::Disconnected, None))
                        );
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        if let Err(err) = Python::attach(signals) {
                            cancellation.0.store(true, Ordering::Relaxed);
                            raised = Some(err);
                        }
                    }
                }
            }
        })
    })
}

/// Runs the handlers of signals that came.
///
/// # Errors
///
/// Fails with the exception that one of them raises, as that of Ctrl-C does.
pub(crate) fn signals(py: Python<'_>) -> PyResult<()> {
    py.check_signals()
}

fn pool() -> Result<Arc<ThreadPool>, rayon::ThreadPoolBuildError> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = &*pool {
        return Ok(Arc::clone(pool));
    }
    // What rayon's threads make at their first task, made now: a process that another thread forks meanwhile would wait
    // for it forever.
    drop(crossbeam_epoch::pin());
    let made = Arc::new(ThreadPoolBuilder::new().build()?);
    *pool = Some(Arc::clone(&made));
    Ok(made)
}

/// Forgets the threads, which are not in this process: Python calls it in the child after `os.fork`.
#[pyfunction]
pub(crate) fn after_fork() {
    // Dropped, the pool would wait for them.
    mem::forget(POOL.lock().unwrap_or_else(PoisonError::into_inner).take());
}
