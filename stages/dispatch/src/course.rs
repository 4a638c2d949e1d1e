//! A motion as a continuous function of time: through every step with the rates it has there.

use nalgebra::{Isometry3, Vector3};
use schemas::candidates::{Candidate, Step};
use spatial::{MovingPose, Passage, Twist, quintic};

use crate::refusal::Refusal;

/// Fewest steps of a motion.
const MIN_STEPS: usize = 2;

/// A motion through a candidate's steps, with the positions, velocities and accelerations that it has
/// at each: a [`Passage`] of the palm and polynomials of fifth degree of the joints between two of them.
#[derive(Debug, Clone)]
pub(crate) struct Course {
    knots: Vec<Knot>,
    /// The palm's way from each knot to the next.
    passages: Vec<Passage>,
}

/// One step.
#[derive(Debug, Clone)]
struct Knot {
    /// Seconds since the first step.
    time_s: f64,
    /// The palm in the object frame.
    palm: MovingPose,
    /// Position, velocity and acceleration of each joint.
    joints: Vec<[f64; 3]>,
}

/// The hand at one time of a course, and how it moves there.
#[derive(Debug, Clone)]
pub(crate) struct Moving {
    /// Pose of the palm in the object frame.
    pub(crate) object_from_palm: Isometry3<f64>,
    /// Joint positions in radians (meters if prismatic).
    pub(crate) q: Vec<f64>,
    /// First derivative with respect to time.
    pub(crate) velocity: Rate,
    /// Second derivative.
    pub(crate) acceleration: Rate,
}

/// A first or second derivative of a hand's pose.
#[derive(Debug, Clone)]
pub(crate) struct Rate {
    /// Of the palm's origin, along the object's axes.
    pub(crate) linear: Vector3<f64>,
    /// The palm's angular velocity or acceleration, along the object's axes.
    pub(crate) angular: Vector3<f64>,
    /// Of the joint positions.
    pub(crate) q: Vec<f64>,
}

impl Rate {
    /// Returns how the palm moves.
    pub(crate) fn twist(&self) -> Twist {
        Twist {
            linear: self.linear,
            angular: self.angular,
        }
    }
}

impl Course {
    /// Takes the course of a candidate whose steps have `dof` joints.
    pub(crate) fn through(candidate: &Candidate, dof: usize) -> Result<Self, Refusal> {
        if candidate.steps.len() < MIN_STEPS {
            return Err(Refusal::Steps {
                found: candidate.steps.len(),
            });
        }
        let mut knots = Vec::with_capacity(candidate.steps.len());
        let mut last_s = f64::NEG_INFINITY;
        for (idx, step) in candidate.steps.iter().enumerate() {
            let knot = Knot::at(step, dof).ok_or(Refusal::Number { step: idx })?;
            if knot.time_s <= last_s {
                return Err(Refusal::Times {
                    step: idx,
                    time_s: knot.time_s,
                    last_s,
                });
            }
            last_s = knot.time_s;
            knots.push(knot);
        }
        let pairs = knots.iter().zip(knots.iter().skip(1)).enumerate();
        let passages = pairs.map(|(idx, (from, to))| {
            Passage::new(&from.palm, &to.palm, to.time_s - from.time_s)
                .ok_or(Refusal::Turn { step: idx + 1 })
        });
        let passages = passages.collect::<Result<_, _>>()?;
        Ok(Self { knots, passages })
    }

    /// Returns how long it takes, in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        self.knots[self.knots.len() - 1].time_s - self.knots[0].time_s
    }

    /// Returns the hand `time_s` after the first step; before it and after the last it stands still
    /// there, at their rates.
    pub(crate) fn at(&self, time_s: f64) -> Moving {
        let start_s = self.knots[0].time_s;
        let time_s = start_s + time_s.clamp(0.0, self.duration_s());
        let after = self.knots.partition_point(|knot| knot.time_s <= time_s);
        // There are two knots at least, and a passage between every two.
        let after = after.clamp(1, self.knots.len() - 1);
        let (from, to) = (&self.knots[after - 1], &self.knots[after]);
        between(from, to, &self.passages[after - 1], time_s - from.time_s)
    }

    /// Returns the hand at the last step.
    pub(crate) fn grasp(&self) -> Moving {
        self.at(self.duration_s())
    }
}

impl Knot {
    /// Takes a step; `None` if a number is not finite or missing.
    fn at(step: &Step, dof: usize) -> Option<Self> {
        let rates = &step.rates;
        let palm = MovingPose {
            pose: *step.object_from_palm.isometry(),
            velocity: Twist::from_array(rates.palm_velocity),
            acceleration: Twist::from_array(rates.palm_acceleration),
        };
        let joints = step.q_rad.iter().zip(&rates.q_velocity_rad_per_s);
        let joints = joints.zip(&rates.q_acceleration_rad_per_s2);
        let joints: Vec<[f64; 3]> = joints
            .map(|((&q, &velocity), &acceleration)| [q, velocity, acceleration])
            .collect();
        let pose = palm.pose.translation.vector.iter();
        let is_finite = pose
            .chain(palm.pose.rotation.coords.iter())
            .chain(joints.iter().flatten())
            .chain([&step.time_s])
            .all(|number| number.is_finite());
        let moves = palm.velocity.is_finite() && palm.acceleration.is_finite();
        let is_whole = step.q_rad.len() == dof && joints.len() == dof;
        (is_finite && moves && is_whole).then_some(Self {
            time_s: step.time_s,
            palm,
            joints,
        })
    }
}

/// Returns the hand `time_s` after one step, of which the other is the next.
fn between(from: &Knot, to: &Knot, passage: &Passage, time_s: f64) -> Moving {
    let palm = passage.at(time_s);
    let duration_s = to.time_s - from.time_s;
    let ends = from.joints.iter().zip(&to.joints);
    let joints: Vec<[f64; 3]> = ends
        .map(|(&from, &to)| quintic(from, to, duration_s, time_s))
        .collect();
    let order = |order: usize| joints.iter().map(|joint| joint[order]).collect();
    let rate = |twist: Twist, q| Rate {
        linear: twist.linear,
        angular: twist.angular,
        q,
    };
    Moving {
        object_from_palm: palm.pose,
        q: order(0),
        velocity: rate(palm.velocity, order(1)),
        acceleration: rate(palm.acceleration, order(2)),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::feasible::testing::candidates;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Every step is met with its rates, and rates are derivatives.
        #[test]
        fn a_course_meets_its_steps_and_its_rates_are_its_derivatives(
            candidate in candidates(3),
            share in 0.001..0.999_f64,
        ) {
            let course = Course::through(&candidate, 3).unwrap();
            for step in &candidate.steps {
                let found = course.at(step.time_s);
                let off = step.object_from_palm.isometry().inverse() * found.object_from_palm;
                prop_assert!(off.translation.vector.norm() < 1e-9);
                prop_assert!(off.rotation.angle() < 1e-7);
                let [_, _, _, x, y, z] = step.rates.palm_velocity;
                prop_assert!((found.velocity.angular - Vector3::new(x, y, z)).norm() < 1e-6);
                let [_, _, _, x, y, z] = step.rates.palm_acceleration;
                prop_assert!((found.acceleration.angular - Vector3::new(x, y, z)).norm() < 1e-4);
                prop_assert!((found.q[1] - step.q_rad[1]).abs() < 1e-9);
            }
            let (time, h) = (share * course.duration_s(), 1e-5);
            let [before, now, after] = [-h, 0.0, h].map(|d| course.at(time + d));
            let turned = after.object_from_palm.rotation * before.object_from_palm.rotation.inverse();
            let spin = turned.scaled_axis() / (2.0 * h);
            prop_assert!((spin - now.velocity.angular).norm() < 1e-3, "{spin} {}", now.velocity.angular);
            let rate = (after.velocity.angular - before.velocity.angular) / (2.0 * h);
            let scale = 1.0 + now.acceleration.angular.norm();
            prop_assert!((rate - now.acceleration.angular).norm() < 2e-2 * scale);
            let rate = (after.velocity.q[0] - before.velocity.q[0]) / (2.0 * h);
            let scale = 1.0 + now.acceleration.q[0].abs();
            prop_assert!((rate - now.acceleration.q[0]).abs() < 2e-2 * scale);
        }
    }
}
