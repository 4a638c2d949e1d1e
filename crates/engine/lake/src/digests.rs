//! Digests of files, and checks of files against them.

use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
};

use ::clock::lock;
use dataflow::Digest;

use crate::atomic;

/// Progress callback: bytes read, bytes in all.
pub type OnBytes<'a> = dyn Fn(u64, u64) + Sync + 'a;

/// Digests a file without holding it in memory.
pub(crate) fn digest_file(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(atomic::open(path)?)?;
    Ok(Digest::from(*hasher.finalize().as_bytes()))
}

/// Reads files on all cores and returns, ordered, the faults of those whose digests differ.
pub(crate) fn check_digests<F: Ord + Send>(
    files: &[(PathBuf, Digest)],
    on_bytes: &OnBytes,
    fault: impl Fn(&Path) -> F + Sync,
) -> (Vec<F>, u64) {
    let sizes = files
        .iter()
        .map(|(path, _)| fs::metadata(path).map_or(0, |m| m.len()));
    let sizes: Vec<u64> = sizes.collect();
    let total = sizes.iter().sum();
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let faults = Mutex::new(Vec::new());
    let work = || {
        loop {
            let idx = next.fetch_add(1, Ordering::Relaxed);
            let (Some((path, expected)), Some(size)) = (files.get(idx), sizes.get(idx)) else {
                return;
            };
            if !digest_file(path).is_ok_and(|digest| digest == *expected) {
                let mut faults = lock(&faults);
                faults.push(fault(path));
            }
            on_bytes(done.fetch_add(*size, Ordering::Relaxed) + size, total);
        }
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..n_threads.min(files.len()) {
            scope.spawn(work);
        }
    });
    let mut faults = faults.into_inner().unwrap_or_else(PoisonError::into_inner);
    faults.sort();
    (faults, total)
}
