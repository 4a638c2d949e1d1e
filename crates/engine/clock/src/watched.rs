//! Work in a thread of its own that is given up when it makes no progress: a network file system
//! that is down blocks its callers for ever.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{RecvTimeoutError, SyncSender, sync_channel},
    },
    thread,
    time::Duration,
};

use crate::simulated::here;

/// Messages that the work may be ahead of its receiver.
const AHEAD: usize = 16;

/// Message of a piece of work.
enum WorkMessage<T, R> {
    Part(T),
    End(R),
}

/// Passes a part of the work on; returns whether there is still a receiver.
pub type Pass<'a, T> = dyn FnMut(T) -> bool + 'a;

/// Runs `work` in a thread and passes its parts to `each`, which says whether it wants more. Returns
/// the result of the work, or `None` if nothing was heard of it for `patience`: its thread is then
/// left to itself.
pub fn watched<T: Send + 'static, R: Send + 'static>(
    patience: Duration,
    work: impl FnOnce(&mut Pass<T>) -> R + Send + 'static,
    mut each: impl FnMut(T) -> bool,
) -> Option<R> {
    if let Some(here) = here() {
        let mut is_wanted = true;
        here.expect_answer(patience);
        let result = work(&mut |part| {
            here.expect_answer(patience);
            is_wanted = is_wanted && each(part);
            is_wanted
        });
        return here.is_answered().then_some(result);
    }
    let (sender, heard) = sync_channel(AHEAD);
    let is_wanted = Arc::new(AtomicBool::new(true));
    let is_wanted_there = Arc::clone(&is_wanted);
    thread::spawn(move || run(work, &sender, &is_wanted_there));
    loop {
        match heard.recv_timeout(patience) {
            Ok(WorkMessage::Part(part)) => {
                if is_wanted.load(Ordering::Relaxed) && !each(part) {
                    is_wanted.store(false, Ordering::Relaxed);
                }
            }
            Ok(WorkMessage::End(result)) => return Some(result),
            // A panic of the work counts as silence.
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return None,
        }
    }
}

fn run<T, R>(
    work: impl FnOnce(&mut Pass<T>) -> R,
    sender: &SyncSender<WorkMessage<T, R>>,
    is_wanted: &AtomicBool,
) {
    let result = work(&mut |part| {
        is_wanted.load(Ordering::Relaxed) && sender.send(WorkMessage::Part(part)).is_ok()
    });
    let _given_up = sender.send(WorkMessage::End(result));
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_millis(50);

    #[test]
    fn parts_come_in_order_and_then_the_result() {
        let mut parts = Vec::new();
        let work = |pass: &mut Pass<u32>| (0..100).filter(|&part| pass(part)).count();
        let result = watched(Duration::from_secs(30), work, |part| {
            parts.push(part);
            true
        });
        assert_eq!(result, Some(100));
        assert!(parts.into_iter().eq(0..100));
    }

    #[test]
    fn silent_work_is_given_up() {
        let silent = |_: &mut Pass<()>| thread::park();
        assert_eq!(watched(SOON, silent, |()| true), None);
    }
}
