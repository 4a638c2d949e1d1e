//! Mutexes, and waiting for what other threads change.

use std::{
    ptr,
    sync::{self, Mutex, MutexGuard, PoisonError, TryLockError},
    time::Duration,
};

use crate::simulated::here;

/// Simulated time between two tries to lock a mutex.
const LOCK_EVERY: Duration = Duration::from_millis(1);

/// Locks a mutex whose contents are whole even if a holder has panicked.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    let Some(here) = here() else {
        return mutex.lock().unwrap_or_else(PoisonError::into_inner);
    };
    loop {
        match mutex.try_lock() {
            Ok(guard) => return guard,
            Err(TryLockError::Poisoned(poisoned)) => return poisoned.into_inner(),
            // Its holder waits for its turn.
            Err(TryLockError::WouldBlock) => here.sleep_even_if_killed(LOCK_EVERY),
        }
    }
}

/// Wakes threads that wait for a change.
#[derive(Debug, Default)]
pub struct Condvar(sync::Condvar);

impl Condvar {
    /// Gives `guard`, of this `mutex`, back until another thread notifies or some time is over.
    pub fn wait_timeout<'m, T>(
        &self,
        guard: MutexGuard<'m, T>,
        mutex: &'m Mutex<T>,
        time: Duration,
    ) -> MutexGuard<'m, T> {
        let Some(here) = here() else {
            let waited = self.0.wait_timeout(guard, time);
            return waited.unwrap_or_else(PoisonError::into_inner).0;
        };
        // No other thread runs before this one waits.
        drop(guard);
        here.wait(time, self.address());
        lock(mutex)
    }

    /// Wakes all threads that wait.
    pub fn notify_all(&self) {
        match here() {
            Some(here) => here.notify(self.address()),
            None => self.0.notify_all(),
        }
    }

    fn address(&self) -> usize {
        ptr::from_ref(self).addr()
    }
}
