//! Monitoring and aborting a motion in execution.

use std::time::Instant;

use super::{Abort, Fault, Shared, lock, stream::PERIOD};
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
pub(super) struct MonitoredMotion<'a> {
    shared: &'a Shared,
    goal_id: &'a str,
    joints: Vec<String>,
    mirror: Option<&'a Mirror>,
    /// The goal's arrival.
    received: Instant,
    pacer: Pacer,
    /// Time of the next published sample, in seconds of the motion: for motions faster than the
    /// clock.
    due_s: f64,
    /// Whether it was aborted.
    halted: bool,
}

impl<'a> MonitoredMotion<'a> {
    pub(super) fn new(
        shared: &'a Shared,
        mirror: Option<&'a Mirror>,
        goal_id: &'a str,
        received: Instant,
    ) -> Self {
        Self {
            shared,
            goal_id,
            joints: shared.robot.joint_names(),
            mirror,
            received,
            pacer: Pacer::default(),
            due_s: 0.0,
            halted: false,
        }
    }

    /// Publishes a sample at its time; returns why the motion must be aborted now, if it must.
    /// Answers the queries that requested it once the palm stands still.
    pub(super) fn see(&mut self, sample: &Sample) -> Option<Abort> {
        let is_first = self.pacer.is_new();
        let real_time = self.shared.config.service.real_time;
        let late_s = if real_time {
            self.pacer.wait(sample.time_s)
        } else {
            self.pacer.wait(0.0)
        };
        if let Some(listener) = lock(&self.shared.ticks).as_ref().filter(|_| real_time) {
            listener(Tick {
                time_s: sample.time_s,
                late_s,
                since_goal_s: self.received.elapsed().as_secs_f64(),
            });
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
        let reason = self.shared.control.reason(self.goal_id);
        if reason.is_some() && !self.halted {
            self.halted = true;
            for query in self.shared.control.awaiting_stop() {
                self.shared.acknowledge(&query, Acknowledgment::Done);
            }
        }
        reason
    }
}
