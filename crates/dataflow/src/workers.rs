//! Running the units of an output on several threads.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicBool, AtomicUsize, Ordering},
};

/// Runs `work` on every item on up to `n_workers` threads and returns the results in the items'
/// order. No item is started after the first failure, so there may be fewer results.
///
/// These threads are not the pool in which stages compute: a thread that holds a unit's lock must
/// not start another unit before it is done.
pub(crate) fn in_order<T: Sync, R: Send, E: Send>(
    items: &[T],
    n_workers: usize,
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Vec<Result<R, E>> {
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let results = Mutex::new(Vec::with_capacity(items.len()));
    let go_through = || {
        while !failed.load(Ordering::Relaxed) {
            let idx = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(idx) else {
                return;
            };
            let result = work(item);
            if result.is_err() {
                failed.store(true, Ordering::Relaxed);
            }
            let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
            results.push((idx, result));
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..n_workers.min(items.len()) {
            scope.spawn(go_through);
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(idx, _)| *idx);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_the_order_of_the_items() {
        let items: Vec<u64> = (0..100).collect();
        let squares = in_order(&items, 4, |&item| Ok::<_, ()>(item * item));
        let expected: Vec<_> = items.iter().map(|item| Ok(item * item)).collect();
        assert_eq!(squares, expected);
    }

    #[test]
    fn nothing_is_started_after_a_failure() {
        let items: Vec<u64> = (0..100).collect();
        let results = in_order(
            &items,
            1,
            |&item| if item < 3 { Ok(item) } else { Err(item) },
        );
        assert_eq!(results, [Ok(0), Ok(1), Ok(2), Err(3)]);
    }
}
