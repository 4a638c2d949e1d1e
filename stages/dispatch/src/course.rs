//! A motion as a continuous function of time: through every step with the rates it has there.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use schemas::candidates::{Candidate, Step};
use simulation::quintic;

use crate::refusal::Refusal;

/// Below this angle in radians the series are more exact than the quotients.
const SMALL_RAD: f64 = 0.05;
/// Fewest steps of a motion.
const MIN_STEPS: usize = 2;

/// A motion through a candidate's steps, with the positions, velocities and accelerations that it has
/// at each: between two of them polynomials of fifth degree in time. The palm's rotation is that of
/// the earlier step turned by the rotation vector that such a polynomial gives.
#[derive(Debug, Clone)]
pub(crate) struct Course {
    knots: Vec<Knot>,
}

/// One step.
#[derive(Debug, Clone)]
struct Knot {
    /// Seconds since the first step.
    time_s: f64,
    /// The palm's rotation in the object frame.
    rotation: UnitQuaternion<f64>,
    /// Value, velocity and acceleration of the palm's position (3), then of each joint.
    numbers: Vec<[f64; 3]>,
    /// The palm's angular velocity and acceleration along the object's axes.
    spin: [Vector3<f64>; 2],
    /// The rotation vector from this step to the next, in this step's palm frame, with its velocity
    /// and acceleration at the next; of the last step zero.
    turn: [Vector3<f64>; 3],
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
        for idx in 1..knots.len() {
            let (before, after) = knots.split_at_mut(idx);
            if let (Some(from), Some(to)) = (before.last_mut(), after.first()) {
                from.turn = turn(from, to).ok_or(Refusal::Turn { step: idx })?;
            }
        }
        Ok(Self { knots })
    }

    /// Returns how long it takes, in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        let time = |knot: Option<&Knot>| knot.map_or(0.0, |knot| knot.time_s);
        time(self.knots.last()) - time(self.knots.first())
    }

    /// Returns the hand `time_s` after the first step; before it and after the last it stands still
    /// there, at their rates.
    pub(crate) fn at(&self, time_s: f64) -> Option<Moving> {
        let start_s = self.knots.first()?.time_s;
        let time_s = start_s + time_s.clamp(0.0, self.duration_s());
        let after = self.knots.partition_point(|knot| knot.time_s <= time_s);
        let after = after.clamp(1, self.knots.len() - 1);
        let (from, to) = (self.knots.get(after - 1)?, self.knots.get(after)?);
        Some(between(from, to, time_s - from.time_s))
    }
}

impl Knot {
    /// Takes a step; `None` if a number is not finite or missing.
    fn at(step: &Step, dof: usize) -> Option<Self> {
        let rates = &step.rates;
        let pose = step.object_from_palm.isometry();
        let [vx, vy, vz, wx, wy, wz] = rates.palm_velocity;
        let [ax, ay, az, bx, by, bz] = rates.palm_acceleration;
        let position = pose.translation.vector;
        let mut numbers = vec![
            [position.x, vx, ax],
            [position.y, vy, ay],
            [position.z, vz, az],
        ];
        let of_joints = step.q_rad.iter().zip(&rates.q_velocity_rad_per_s);
        let of_joints = of_joints.zip(&rates.q_acceleration_rad_per_s2);
        numbers.extend(of_joints.map(|((&q, &velocity), &rate)| [q, velocity, rate]));
        let all = numbers.iter().flatten().chain(pose.rotation.coords.iter());
        let all = all.chain(&rates.palm_velocity);
        let is_finite = all
            .chain(&rates.palm_acceleration)
            .chain([&step.time_s])
            .all(|number| number.is_finite());
        let is_whole = step.q_rad.len() == dof && numbers.len() == 3 + dof;
        (is_finite && is_whole).then(|| Self {
            time_s: step.time_s,
            rotation: pose.rotation,
            numbers,
            spin: [Vector3::new(wx, wy, wz), Vector3::new(bx, by, bz)],
            turn: [Vector3::zeros(); 3],
        })
    }
}

/// Returns the rotation vector from one step to the next and its derivatives there.
///
/// The angular velocity along the first step's axes is `ω = J(φ) φ′`, its derivative `J φ″ + J′ φ′`
/// with the left Jacobian J of the rotation group; here they are solved for φ′ and φ″.
fn turn(from: &Knot, to: &Knot) -> Option<[Vector3<f64>; 3]> {
    let phi = (from.rotation.inverse() * to.rotation).scaled_axis();
    let [spin, spin_rate] = to.spin.map(|spin| from.rotation.inverse() * spin);
    let inverse = left_jacobian(&phi).try_inverse()?;
    let velocity = inverse * spin;
    let acceleration = inverse * (spin_rate - left_jacobian_rate(&phi, &velocity));
    Some([phi, velocity, acceleration])
}

/// Returns the hand `time_s` after one step, of which the other is the next.
fn between(from: &Knot, to: &Knot, time_s: f64) -> Moving {
    let duration_s = to.time_s - from.time_s;
    let ends = from.numbers.iter().zip(&to.numbers);
    let numbers: Vec<[f64; 3]> = ends
        .map(|(&from, &to)| quintic(from, to, duration_s, time_s))
        .collect();
    let start = from.spin.map(|spin| from.rotation.inverse() * spin);
    let mut phi = [Vector3::zeros(); 3];
    for axis in 0..3 {
        // At its beginning a rotation vector's derivatives are those of the angle turned.
        let first = [0.0, start[0][axis], start[1][axis]];
        let last = from.turn.map(|turn| turn[axis]);
        let found = quintic(first, last, duration_s, time_s);
        for (phi, found) in phi.iter_mut().zip(found) {
            phi[axis] = found;
        }
    }
    let [phi, phi_1, phi_2] = phi;
    let jacobian = left_jacobian(&phi);
    let position = |order: usize| {
        let mut xyz = numbers.iter().map(|number| number[order]);
        Vector3::from_fn(|_, _| xyz.next().unwrap_or(0.0))
    };
    let joints = |order: usize| {
        let joints = numbers.iter().skip(3);
        joints.map(|number| number[order]).collect()
    };
    Moving {
        object_from_palm: Isometry3::from_parts(
            Translation3::from(position(0)),
            from.rotation * UnitQuaternion::from_scaled_axis(phi),
        ),
        q: joints(0),
        velocity: Rate {
            linear: position(1),
            angular: from.rotation * (jacobian * phi_1),
            q: joints(1),
        },
        acceleration: Rate {
            linear: position(2),
            angular: from.rotation * (jacobian * phi_2 + left_jacobian_rate(&phi, &phi_1)),
            q: joints(2),
        },
    }
}

/// Returns the matrix that takes a rotation vector's derivative to the angular velocity along fixed
/// axes: `1 + b φ× + c φ×φ×` (Barfoot, *State Estimation for Robotics*, 2017, §7.1.5).
fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let cross = phi.cross_matrix();
    let [b, c] = coefficients(phi.norm());
    Matrix3::identity() + cross * b + cross * cross * c
}

/// Returns the derivative of [`left_jacobian`] along a rotation vector's velocity, times that velocity.
fn left_jacobian_rate(phi: &Vector3<f64>, velocity: &Vector3<f64>) -> Vector3<f64> {
    let [_, c] = coefficients(phi.norm());
    let [b_slope, c_slope] = slopes(phi.norm());
    let along = phi.dot(velocity);
    let once = phi.cross(velocity);
    once * (b_slope * along) + phi.cross(&once) * (c_slope * along) + velocity.cross(&once) * c
}

/// `(1 − cos θ)/θ²` and `(θ − sin θ)/θ³`.
fn coefficients(angle: f64) -> [f64; 2] {
    let sq = angle * angle;
    if angle < SMALL_RAD {
        return [
            0.5 - sq / 24.0 + sq * sq / 720.0,
            1.0 / 6.0 - sq / 120.0 + sq * sq / 5040.0,
        ];
    }
    [
        (1.0 - angle.cos()) / sq,
        (angle - angle.sin()) / (sq * angle),
    ]
}

/// The derivatives of [`coefficients`] by the angle, over the angle.
fn slopes(angle: f64) -> [f64; 2] {
    let sq = angle * angle;
    if angle < SMALL_RAD {
        return [-1.0 / 12.0 + sq / 180.0, -1.0 / 60.0 + sq / 1260.0];
    }
    let [sin, cos] = [angle.sin(), angle.cos()];
    [
        (angle * sin - 2.0 * (1.0 - cos)) / (sq * sq),
        (angle * (1.0 - cos) - 3.0 * (angle - sin)) / (sq * sq * angle),
    ]
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
                let found = course.at(step.time_s).unwrap();
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
            let [before, now, after] = [-h, 0.0, h].map(|d| course.at(time + d).unwrap());
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
