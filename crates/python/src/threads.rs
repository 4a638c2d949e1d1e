//! The module's own threads: those of the whole process would be gone in a process that `fork` made.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::failed;

static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Computes without the interpreter's lock, in as many threads as the process may use.
pub(crate) fn in_threads<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    py.detach(|| {
        let pool = pool().map_err(|err| {
            let hint = "raise the limit of threads (`ulimit -u`), or set `RAYON_NUM_THREADS`";
            failed(&err, Some(hint.to_owned()))
        })?;
        Ok(pool.install(compute))
    })
}

fn pool() -> Result<Arc<ThreadPool>, rayon::ThreadPoolBuildError> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = &*pool {
        return Ok(Arc::clone(pool));
    }
    let made = Arc::new(ThreadPoolBuilder::new().build()?);
    *pool = Some(Arc::clone(&made));
    Ok(made)
}

/// Forgets the threads, which are not in this process: Python calls it in the child after `os.fork`.
#[pyfunction]
pub(crate) fn after_fork() {
    // Dropped, the pool would wait for them.
    std::mem::forget(POOL.lock().unwrap_or_else(PoisonError::into_inner).take());
}
