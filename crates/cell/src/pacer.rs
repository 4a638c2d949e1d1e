//! Paced execution of steps.

use std::{
    thread,
    time::{Duration, Instant},
};

/// Paces the steps of a motion by their times, counted from the first.
#[derive(Debug, Default)]
pub struct Pacer {
    started: Option<Instant>,
}

impl Pacer {
    /// Waits until `time_s` seconds after the first step, which starts now if this is it; returns
    /// the lateness in seconds.
    pub fn wait(&mut self, time_s: f64) -> f64 {
        let started = *self.started.get_or_insert_with(Instant::now);
        let due = started + Duration::from_secs_f64(time_s.max(0.0));
        thread::sleep(due.saturating_duration_since(Instant::now()));
        due.elapsed().as_secs_f64()
    }
}
