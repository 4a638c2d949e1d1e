//! By how much a sampled motion exceeds its limits.

use motion::{JointPoint, PalmPoint};
use nalgebra::Vector3;
use spatial::{Peaks, Table, Twist};

use crate::{
    grasp_motion::{MotionPhase, PhaseDurations},
    limits::{LimitedRates, Limits, MotionLimits},
};

/// Slowdown factor of each phase of a motion that its limits require.
///
/// Commands are checked twice: by the greatest velocities and accelerations of the quintic polynomials that a
/// controller interpolates between two points; and by the differences of positions over one period, for a
/// controller that reads positions alone. Before and after, the robot rests.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LimitExcess {
    reach: f64,
    close: f64,
    squeeze: f64,
    lift: f64,
}

impl LimitExcess {
    /// Returns the excess of a phase.
    pub(crate) fn phase(&self, phase: MotionPhase) -> f64 {
        match phase {
            MotionPhase::Reach => self.reach,
            MotionPhase::Close => self.close,
            MotionPhase::Squeeze => self.squeeze,
            MotionPhase::Lift => self.lift,
        }
    }

    /// Records the excess of a palm trajectory.
    pub(crate) fn check_palm(
        &mut self,
        points: &[PalmPoint],
        limits: &Limits,
        durations: &PhaseDurations,
    ) {
        let kept = limits.palm_peaks();
        for (from, to) in points.iter().zip(points.iter().skip(1)) {
            // What no rotation vector follows is turned without end.
            let endless = Peaks {
                angular_speed: f64::INFINITY,
                ..Peaks::zero()
            };
            let segment = from.segment(to);
            let peaks = segment.map_or(endless, |segment| segment.peaks(&kept));
            let along = |linear: f64, angular: f64| {
                Twist::<Table>::new(Vector3::x() * linear, Vector3::x() * angular)
            };
            let velocity = along(peaks.speed, peaks.angular_speed);
            let acceleration = along(peaks.acceleration, peaks.angular_acceleration);
            self.record_segment(durations, from.time_s, to.time_s, || {
                limits.palm_rates(&velocity, &acceleration)
            });
        }
        let velocity = |from: &PalmPoint, to: &PalmPoint| {
            let rate = 1.0 / (to.time_s - from.time_s);
            let [a, b] = [from, to].map(|point| point.table_from_palm);
            Twist::<Table>::new(
                (b.translation.vector - a.translation.vector) * rate,
                (b.rotation * a.rotation.inverse()).scaled_axis() * rate,
            )
        };
        let mut before = Twist::zero();
        for (idx, point) in points.iter().enumerate() {
            let next = points.get(idx + 1);
            let after = next.map_or_else(Twist::zero, |next| velocity(point, next));
            let rate = rate(points.get(idx.wrapping_sub(1)), point, next, |p| p.time_s);
            let change = (after - before) * rate;
            self.record(
                durations.phase(point.time_s),
                limits.palm_rates(&after, &change),
            );
            before = after;
        }
    }

    /// Records the excess of joint trajectories.
    pub(crate) fn check_joints(
        &mut self,
        points: &[JointPoint],
        limits: &[MotionLimits],
        durations: &PhaseDurations,
    ) {
        let is_limited = points.iter().all(|point| point.q_rad.len() == limits.len());
        assert!(is_limited, "every joint has a limit");
        for (from, to) in points.iter().zip(points.iter().skip(1)) {
            self.record_segment(durations, from.time_s, to.time_s, || {
                let segments = from.segments(to).zip(limits);
                segments.map(|(segment, limits)| {
                    let velocity = segment.max_speed(limits.max_velocity);
                    let acceleration = segment.max_acceleration(limits.max_acceleration);
                    LimitedRates::of_joint(velocity, acceleration, *limits)
                })
            });
        }
        let dof = points.first().map_or(0, |point| point.q_rad.len());
        let mut before = vec![0.0; dof];
        for (idx, point) in points.iter().enumerate() {
            let next = points.get(idx + 1);
            let after = next.map_or_else(
                || vec![0.0; dof],
                |next| {
                    differences(
                        &point.q_rad,
                        &next.q_rad,
                        1.0 / (next.time_s - point.time_s),
                    )
                },
            );
            let rate = rate(points.get(idx.wrapping_sub(1)), point, next, |p| p.time_s);
            let change = differences(&before, &after, rate);
            let joints = after.iter().zip(&change).zip(limits);
            self.record(
                durations.phase(point.time_s),
                joints.map(|((&velocity, &change), limits)| {
                    LimitedRates::of_joint(velocity, change, *limits)
                }),
            );
            before = after;
        }
    }

    /// Records the rates between two points, which may be of two phases.
    fn record_segment<I: IntoIterator<Item = LimitedRates>>(
        &mut self,
        durations: &PhaseDurations,
        from_s: f64,
        to_s: f64,
        rates: impl Fn() -> I,
    ) {
        let both = [durations.phase(from_s), durations.phase(to_s)];
        self.record(both[0], rates());
        if both[0] != both[1] {
            self.record(both[1], rates());
        }
    }

    fn record(&mut self, phase: MotionPhase, rates: impl IntoIterator<Item = LimitedRates>) {
        let worst = match phase {
            MotionPhase::Reach => &mut self.reach,
            MotionPhase::Close => &mut self.close,
            MotionPhase::Squeeze => &mut self.squeeze,
            MotionPhase::Lift => &mut self.lift,
        };
        for rates in rates {
            *worst = worst.max(rates.excess());
        }
    }
}

/// Returns the inverse of the time between the middles of the periods before and after a point; at an end
/// there is but one.
fn rate<T>(before: Option<&T>, point: &T, after: Option<&T>, time_s: impl Fn(&T) -> f64) -> f64 {
    let back = before.map(|before| time_s(point) - time_s(before));
    let forth = after.map(|after| time_s(after) - time_s(point));
    match (back, forth) {
        (Some(back), Some(forth)) => 2.0 / (back + forth),
        (Some(one), None) | (None, Some(one)) => 1.0 / one,
        (None, None) => 0.0,
    }
}

fn differences(from: &[f64], to: &[f64], rate: f64) -> Vec<f64> {
    let both = from.iter().zip(to);
    both.map(|(from, to)| (to - from) * rate).collect()
}
