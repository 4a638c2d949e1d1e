//! By how much a sampled motion exceeds its limits.

use cell::{JointPoint, PalmPoint};
use spatial::{Twist, quintic};

use crate::{
    limits::{self, Limits},
    motion::{Lengths, Part},
};

/// Parts of a period between two points at whose ends velocities are looked at.
const LOOKS: u8 = 8;

/// How many times as slow each part of a motion must be for its limits.
///
/// What is told is judged three times: by the velocities and accelerations that go with the points; by
/// the velocities of joints between them, on the polynomial that goes through both; and by what a
/// controller sees that is told positions alone, differences over one period. Before and after, the robot
/// rests.
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
        for point in points {
            let part = lengths.part(point.time_s);
            self.see(part, limits.of_palm(&point.velocity, &point.acceleration));
        }
        let velocity = |from: &PalmPoint, to: &PalmPoint| {
            let rate = 1.0 / (to.time_s - from.time_s);
            let [a, b] = [from, to].map(|point| point.table_from_palm.isometry());
            Twist {
                linear: (b.translation.vector - a.translation.vector) * rate,
                angular: (b.rotation * a.rotation.inverse()).scaled_axis() * rate,
            }
        };
        let mut before = Twist::zero();
        for (idx, point) in points.iter().enumerate() {
            let next = points.get(idx + 1);
            let after = next.map_or_else(Twist::zero, |next| velocity(point, next));
            let rate = rate(points.get(idx.wrapping_sub(1)), point, next, |p| p.time_s);
            let change = Twist {
                linear: (after.linear - before.linear) * rate,
                angular: (after.angular - before.angular) * rate,
            };
            self.see(lengths.part(point.time_s), limits.of_palm(&after, &change));
            before = after;
        }
    }

    /// Looks at the joints of a hand.
    pub(crate) fn of_joints(&mut self, points: &[JointPoint], limits: &Limits, lengths: &Lengths) {
        self.of_track(points, lengths, |velocity, acceleration| {
            limits.of_joints(velocity, acceleration)
        });
    }

    /// Looks at joints whose limits `parts` knows, by their velocities and accelerations.
    pub(crate) fn of_track(
        &mut self,
        points: &[JointPoint],
        lengths: &Lengths,
        parts: impl Fn(&[f64], &[f64]) -> Vec<limits::Part>,
    ) {
        let dof = points.first().map_or(0, |point| point.q_rad.len());
        let mut before = vec![0.0; dof];
        for (idx, point) in points.iter().enumerate() {
            let part = lengths.part(point.time_s);
            self.see(
                part,
                parts(&point.velocity_rad_per_s, &point.acceleration_rad_per_s2),
            );
            let next = points.get(idx + 1);
            if let Some(next) = next {
                for look in 1..LOOKS {
                    let share = f64::from(look) / f64::from(LOOKS);
                    let between: Vec<f64> = between(point, next, share).collect();
                    self.see(part, parts(&between, &vec![0.0; dof]));
                }
            }
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
            self.see(part, parts(&after, &differences(&before, &after, rate)));
            before = after;
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

/// Returns the joints' velocities after a share of the time between two points.
fn between(from: &JointPoint, to: &JointPoint, share: f64) -> impl Iterator<Item = f64> {
    let duration_s = to.time_s - from.time_s;
    let ends = from.ends().zip(to.ends());
    ends.map(move |(from, to)| quintic(from, to, duration_s, share * duration_s)[1])
}

fn differences(from: &[f64], to: &[f64], rate: f64) -> Vec<f64> {
    let both = from.iter().zip(to);
    both.map(|(from, to)| (to - from) * rate).collect()
}
