//! By how much a sampled motion exceeds its limits.

use motion::{JointPoint, PalmPoint};
use nalgebra::Vector3;
use spatial::{Peaks, Table, Twist};

use crate::{
    limits::{self, Limits, Most},
    whole::{Lengths, Part},
};

/// How many times as slow each part of a motion must be for its limits.
///
/// What is told is judged twice: by the greatest velocities and accelerations of what a controller makes of
/// it, the polynomials of fifth degree through two points and all between them; and by what one sees that
/// is told positions alone, differences over one period. Before and after, the robot rests.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Excess {
    way: f64,
    close: f64,
    squeeze: f64,
    lift: f64,
}

impl Excess {
    /// Returns the excess of a part.
    pub(crate) fn of(&self, part: Part) -> f64 {
        match part {
            Part::Way => self.way,
            Part::Close => self.close,
            Part::Squeeze => self.squeeze,
            Part::Lift => self.lift,
        }
    }

    /// Looks at a palm.
    pub(crate) fn of_palm(&mut self, points: &[PalmPoint], limits: &Limits, lengths: &Lengths) {
        let kept = limits.of_palm_alone();
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
            self.see_between(lengths, from.time_s, to.time_s, || {
                limits.of_palm(&velocity, &acceleration)
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
            let change = Twist::new(
                (after.linear - before.linear) * rate,
                (after.angular - before.angular) * rate,
            );
            self.see(lengths.part(point.time_s), limits.of_palm(&after, &change));
            before = after;
        }
    }

    /// Looks at joints that may be so fast.
    pub(crate) fn of_joints(&mut self, points: &[JointPoint], most: &[Most], lengths: &Lengths) {
        let is_limited = points.iter().all(|point| point.q_rad.len() == most.len());
        assert!(is_limited, "every joint has a limit");
        for (from, to) in points.iter().zip(points.iter().skip(1)) {
            self.see_between(lengths, from.time_s, to.time_s, || {
                let segments = from.segments(to).zip(most);
                segments.map(|(segment, most)| {
                    let velocity = segment.greatest_speed(most.velocity);
                    let acceleration = segment.greatest_acceleration(most.acceleration);
                    limits::Part::of_joint(velocity, acceleration, *most)
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
            let joints = after.iter().zip(&change).zip(most);
            self.see(
                lengths.part(point.time_s),
                joints.map(|((&velocity, &change), most)| {
                    limits::Part::of_joint(velocity, change, *most)
                }),
            );
            before = after;
        }
    }

    /// Looks at what is between two points, which may be of two parts.
    fn see_between<I: IntoIterator<Item = limits::Part>>(
        &mut self,
        lengths: &Lengths,
        from_s: f64,
        to_s: f64,
        parts: impl Fn() -> I,
    ) {
        let both = [lengths.part(from_s), lengths.part(to_s)];
        self.see(both[0], parts());
        if both[0] != both[1] {
            self.see(both[1], parts());
        }
    }

    fn see(&mut self, part: Part, parts: impl IntoIterator<Item = limits::Part>) {
        let worst = match part {
            Part::Way => &mut self.way,
            Part::Close => &mut self.close,
            Part::Squeeze => &mut self.squeeze,
            Part::Lift => &mut self.lift,
        };
        for part in parts {
            *worst = worst.max(part.excess());
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
