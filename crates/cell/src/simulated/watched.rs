//! A motion in execution, for those who watch or have a word in it.

use std::{
    thread,
    time::{Duration, Instant},
};

use super::{Fault, Shared, reply, stream::PERIOD};
use crate::{
    report::{Sample, Word},
    ros2::Mirror,
    wire,
};

/// Rounding that a sample's time may have, in seconds.
const ROUNDING_S: f64 = 1e-6;

/// A motion in execution, as those see it who watch or have a word in it.
pub(super) struct Watched<'a> {
    shared: &'a Shared,
    goal_id: &'a str,
    joints: Vec<String>,
    mirror: Option<&'a Mirror>,
    /// When the first sample was taken.
    started: Option<Instant>,
    /// Time of the next sample that is published, in seconds of the motion: of a motion that is
    /// faster than the clock.
    due_s: f64,
}

impl<'a> Watched<'a> {
    pub(super) fn new(shared: &'a Shared, mirror: Option<&'a Mirror>, goal_id: &'a str) -> Self {
        Self {
            shared,
            goal_id,
            joints: shared.model.joint_names(),
            mirror,
            started: None,
            due_s: 0.0,
        }
    }

    /// Shows a sample at its time; returns why the motion is to be broken off now, if it is.
    pub(super) fn see(&mut self, sample: &Sample) -> Option<String> {
        let is_first = self.started.is_none();
        let started = *self.started.get_or_insert_with(Instant::now);
        let real_time = self.shared.config.service.real_time;
        if real_time {
            let at = started + Duration::from_secs_f64(sample.time_s);
            thread::sleep(at.saturating_duration_since(Instant::now()));
        }
        if !is_first {
            self.shared.faults.die(Fault::DieInMotion);
        }
        self.shared.stream.measure(self.goal_id, sample);
        if !real_time && sample.time_s > self.due_s - ROUNDING_S {
            self.shared.stream.publish();
            self.due_s += PERIOD.as_secs_f64();
        }
        if let Some(mirror) = self.mirror {
            mirror.show(&self.joints, sample);
        }
        self.shared.control.reason(self.goal_id)
    }

    /// Tells those who asked that the palm stands still.
    pub(super) fn halted(&self) {
        for query in self.shared.control.asking() {
            reply(&query, &wire::line(&Word::Done));
        }
    }
}
