//! Monitoring and aborting a motion in execution.

use std::time::Instant;

use super::{Abort, Fault, Shared, journal::Job, lock, stream::PERIOD};
use crate::{capabilities::Acknowledgment, pacer::Pacer, report::Sample, ros2::Mirror};

/// Rounding that a sample's time may have, in seconds.
const ROUNDING_S: f64 = 1e-6;

/// A step of the real-time control loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tick {
    /// Its scheduled time, in seconds since the first step.
    pub time_s: f64,
    /// Its lateness, in seconds.
    pub late_s: f64,
    /// Seconds since the goal's arrival.
    pub since_goal_s: f64,
}

/// A motion in execution, with its watchers and abort requests.
pub struct MonitoredMotion<'a> {
    shared: &'a Shared,
    mirror: Option<&'a Mirror>,
    goal_id: &'a str,
    /// The goal's arrival.
    received: Instant,
    pacer: Pacer,
    /// Time of the next published sample, in seconds of the motion: for motions faster than the
    /// clock.
    due_s: f64,
}

impl<'a> MonitoredMotion<'a> {
    pub(super) fn new(shared: &'a Shared, mirror: Option<&'a Mirror>, job: &'a Job) -> Self {
        Self {
            shared,
            mirror,
            goal_id: &job.encoded.goal_id,
            received: job.received,
            pacer: Pacer::default(),
            due_s: 0.0,
        }
    }

    /// Waits until `time_s` seconds after the first call, in real time; returns the lateness in
    /// seconds.
    pub fn pace(&mut self, time_s: f64) -> f64 {
        if !self.shared.real_time {
            return 0.0;
        }
        let late_s = self.pacer.wait(time_s);
        if let Some(listener) = lock(&self.shared.ticks).as_ref() {
            listener(Tick {
                time_s,
                late_s,
                since_goal_s: self.received.elapsed().as_secs_f64(),
            });
        }
        late_s
    }

    /// Publishes a measurement, its joints in the order of the machine's description; returns why
    /// the motion must be aborted now, if it must.
    pub fn see(&mut self, sample: &Sample) -> Option<Abort> {
        if sample.time_s > 0.0 {
            self.shared.faults.die(Fault::DieInMotion);
        }
        self.shared.stream.measure(self.goal_id, sample);
        if !self.shared.real_time && sample.time_s > self.due_s - ROUNDING_S {
            self.shared.stream.publish();
            self.due_s += PERIOD.as_secs_f64();
        }
        if let Some(mirror) = self.mirror {
            mirror.show(&self.shared.description.joints, sample);
        }
        self.abort()
    }

    /// Returns why the motion must be aborted now, if it must.
    pub fn abort(&self) -> Option<Abort> {
        self.shared.control.reason(self.goal_id)
    }

    /// Answers the requests to stop: nothing moves any more.
    pub fn has_stopped(&self) {
        for query in self.shared.control.awaiting_stop() {
            self.shared.acknowledge(&query, Acknowledgment::Done);
        }
    }
}
