//! The control loop of one motion.

use std::time::{Duration, Instant};

use cell::{Abort, Goal, MonitoredMotion, PalmTrajectory, Sample, ros2_now_ns};
use robot::JointOrder;
use schemas::executions::Outcome;
use spatial::{Object, Pose, Table};

use crate::{config::Controller, machine::Ros2Machine, path::JointPath};

/// Period of the control loop, and of slices and samples, in seconds.
const TICK_S: f64 = 0.004;
const SLICE_S: f64 = 0.04;
const SAMPLE_S: f64 = 0.01;
/// Longest time from a command to its measurement, in seconds.
const LATENCY_S: f64 = 0.15;
/// Time for which a robot that was stopped is watched, in seconds, and time after which one that
/// still moves is given up.
const WATCH_S: f64 = 0.3;
const GIVE_UP_S: f64 = 2.0;

/// A motion in execution.
pub(crate) struct ExecutingMotion<'a> {
    machine: &'a Ros2Machine,
    path: JointPath,
    /// From the machine's order of joints to the path's, the arm's and then the hand's, and back.
    to_path: JointOrder,
    to_machine: JointOrder,
    /// When the goal's first row is due, by the monotonic clock and as a stamp.
    origin: Instant,
    origin_ns: i64,
    /// The object's pose as the goal has it, for where nothing measures it.
    table_from_object: Pose<Table, Object>,
    pub(crate) samples: Vec<Sample>,
    /// Why it was aborted, if it was.
    pub(crate) aborted: Option<Abort>,
}

impl<'a> ExecutingMotion<'a> {
    /// Plans the motion from where the robot is; `None` where that, or an arm, is unknown.
    pub(crate) fn new(machine: &'a Ros2Machine, goal: &Goal) -> Option<Self> {
        let PalmTrajectory::Arm(arm) = &goal.carrier else {
            return None;
        };
        let measured = machine.measured([&arm.joints, &goal.hand.joints])?;
        let config = &machine.config;
        let measured = measured.each_ref().map(Vec::as_slice);
        let path = JointPath::new(goal, measured, config.approach_rad_per_s, config.brake_s)?;
        let approach = Duration::from_secs_f64(-path.begin_s);
        let approach_ns = i64::try_from(approach.as_nanos()).ok()?;
        let orders = [machine.robot.joint_names(), goal.joint_names()];
        Some(Self {
            to_path: JointOrder::new(&orders[0], &orders[1]).ok()?,
            to_machine: JointOrder::new(&orders[1], &orders[0]).ok()?,
            machine,
            path,
            origin: Instant::now() + approach,
            origin_ns: ros2_now_ns() + approach_ns,
            table_from_object: goal.table_from_object,
            samples: Vec::new(),
            aborted: None,
        })
    }

    /// Moves until the goal's end, or until the robot rests after a brake; returns why it does not
    /// rest, if it does not.
    pub(crate) fn run(&mut self, goal: &Goal, motion: &mut MonitoredMotion<'_>) -> Option<String> {
        // Rows may go on beyond the hold.
        let last = self
            .path
            .tracks
            .iter()
            .filter_map(|track| track.points.last());
        let end_s = last.fold(goal.end_s(), |end_s, point| end_s.max(point.time_s));
        let (begin_s, max_age_s) = (self.path.begin_s, self.machine.config.max_age_s);
        let (mut slice_s, mut followed_s) = (begin_s, f64::INFINITY);
        let mut rested_s = None;
        loop {
            let now_s = self.now_s();
            let abort = self
                .watch(now_s, motion)
                .or_else(|| self.fault(now_s, followed_s));
            if let Some(abort) = abort.filter(|_| self.aborted.is_none()) {
                // A robot without slices for long has begun its brake without being told.
                self.path.brake(now_s.min(followed_s));
                self.aborted = Some(abort);
                slice_s = now_s;
            }
            if now_s >= slice_s {
                self.send(now_s);
                followed_s = self.path.followed_until_s(now_s);
                slice_s = now_s + SLICE_S;
            }
            match self.path.rests_from_s() {
                None if now_s >= end_s => return None,
                Some(rests_s) if rested_s.is_none() && now_s >= rests_s + LATENCY_S => {
                    match self.machine.measurements.check_still(max_age_s) {
                        Ok(()) => {
                            motion.has_stopped();
                            rested_s = Some(now_s);
                        }
                        Err(why) if now_s > rests_s + GIVE_UP_S => return Some(why),
                        Err(_) => {}
                    }
                }
                _ => {}
            }
            if rested_s.is_some_and(|rested_s| now_s > rested_s + WATCH_S) {
                motion.has_stopped();
                return None;
            }
            let ticks = ((self.now_s() - begin_s) / TICK_S).floor() + 1.0;
            motion.pace(ticks * TICK_S);
        }
    }

    /// Shows a sample if one is due, and records it if it is of the goal; returns why the motion must be aborted, if
    /// it must.
    fn watch(&mut self, now_s: f64, motion: &mut MonitoredMotion<'_>) -> Option<Abort> {
        let due_s = self
            .samples
            .last()
            .map_or(self.path.begin_s, |last| last.time_s + SAMPLE_S);
        if now_s < due_s {
            return motion.abort();
        }
        let Some(sample) = self.sample(now_s) else {
            return motion.abort();
        };
        let abort = motion.see(&sample);
        // The way to the first row is none of the goal's, and a robot that braked on it never began the goal.
        if let Ok(sample) = sample.in_order(&self.to_path)
            && now_s >= 0.0
            && self.path.is_on_the_goal()
        {
            self.samples.push(sample);
        }
        abort
    }

    fn sample(&self, now_s: f64) -> Option<Sample> {
        let [arm, hand] = self.path.at(now_s)?;
        let commanded = [arm.q_rad, hand.q_rad].concat();
        let commanded = self.to_machine.apply(&commanded).ok()?;
        self.machine
            .sample(now_s, Some(commanded), self.table_from_object)
    }

    /// Returns what is wrong with the motion, if anything is.
    fn fault(&self, now_s: f64, followed_s: f64) -> Option<Abort> {
        let config = &self.machine.config;
        let aborted = |message: String| Abort {
            outcome: Outcome::Aborted,
            message,
        };
        if now_s > followed_s {
            let late_s = now_s - followed_s;
            return Some(aborted(format!(
                "the cell's control loop was {late_s:.2} s late"
            )));
        }
        if let Err(why) = self.machine.measurements.check_fresh(config.max_age_s) {
            return Some(aborted(why));
        }
        let names = self
            .path
            .tracks
            .each_ref()
            .map(|track| track.joints.as_slice());
        let measured = self.machine.measured(names)?;
        for (part, (controller, q)) in [&config.arm, &config.hand]
            .into_iter()
            .zip(&measured)
            .enumerate()
        {
            if let Some(why) = self.deviation(part, controller, q, now_s) {
                return Some(aborted(why));
            }
        }
        None
    }

    /// Returns which joint of a controller is too far from all commands of the last moments.
    fn deviation(
        &self,
        part: usize,
        controller: &Controller,
        q: &[f64],
        now_s: f64,
    ) -> Option<String> {
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; q.len()];
        for share in 0..=4 {
            let points = self.path.at(now_s - LATENCY_S * f64::from(share) / 4.0)?;
            let commanded = &points.get(part)?.q_rad;
            for (range, q) in ranges.iter_mut().zip(commanded) {
                *range = [range[0].min(*q), range[1].max(*q)];
            }
        }
        let names = &self.path.tracks.get(part)?.joints;
        names
            .iter()
            .zip(q)
            .zip(ranges)
            .find_map(|((name, &q), [low, high])| {
                let off_rad = (low - q).max(q - high);
                (off_rad > controller.tracking_rad)
                    .then(|| format!("joint `{name}` is {off_rad:.3} rad from its command"))
            })
    }

    fn send(&self, now_s: f64) {
        if let Some(slice) = self.path.slice(now_s) {
            let names = self
                .path
                .tracks
                .each_ref()
                .map(|track| track.joints.as_slice());
            self.machine.controllers.send(&slice, self.origin_ns, names);
        }
    }

    /// Returns the seconds since the goal's first row was due.
    fn now_s(&self) -> f64 {
        let now = Instant::now();
        let after = now.saturating_duration_since(self.origin).as_secs_f64();
        after - self.origin.saturating_duration_since(now).as_secs_f64()
    }

    /// Returns how far the object rose, in meters.
    pub(crate) fn lift_m(&self) -> f64 {
        let height = |sample: &Sample| sample.table_from_object.translation.z;
        let ends = self.samples.first().zip(self.samples.last());
        ends.map_or(0.0, |(first, last)| height(last) - height(first))
    }
}
