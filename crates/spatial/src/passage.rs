//! From one moving pose to the next, without a jump in place, velocity or acceleration.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

/// Below this angle in radians the series are more exact than the quotients.
const SMALL_RAD: f64 = 0.05;

/// A pose on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingPose {
    /// The pose of the moving frame in the resting one.
    pub pose: Isometry3<f64>,
    /// How fast it moves.
    pub velocity: Twist,
    /// How fast that changes.
    pub acceleration: Twist,
}

/// A first or second derivative of a pose with respect to time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Of the origin, along the resting frame's axes, in m/s or m/s².
    pub linear: Vector3<f64>,
    /// Angular velocity or acceleration along the resting frame's axes, in rad/s or rad/s².
    pub angular: Vector3<f64>,
}

impl Twist {
    /// Returns the twist of what does not move.
    pub fn zero() -> Self {
        Self {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
        }
    }

    /// Takes six numbers: linear, then angular.
    pub fn from_array([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self {
            linear: Vector3::new(x, y, z),
            angular: Vector3::new(a, b, c),
        }
    }

    /// Returns six numbers: linear, then angular.
    pub fn to_array(&self) -> [f64; 6] {
        let (v, w) = (self.linear, self.angular);
        [v.x, v.y, v.z, w.x, w.y, w.z]
    }

    /// Returns the twist with its axes turned.
    #[must_use]
    pub fn turned(&self, by: &UnitQuaternion<f64>) -> Self {
        Self {
            linear: by * self.linear,
            angular: by * self.angular,
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.to_array().iter().all(|number| number.is_finite())
    }
}

/// The way between two moving poses: polynomials of fifth degree in time that have both ends'
/// positions, velocities and accelerations. The rotation is that of the first end turned by the
/// rotation vector that such a polynomial gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Passage {
    from: MovingPose,
    to: MovingPose,
    duration_s: f64,
    /// The rotation vector from the first end to the second, in the first's moving frame, with its
    /// velocity and acceleration at the second.
    turn: [Vector3<f64>; 3],
}

impl Passage {
    /// Takes two ends `duration_s` apart; `None` if no rotation vector follows the turn between them,
    /// which is then about a whole one.
    pub fn new(from: &MovingPose, to: &MovingPose, duration_s: f64) -> Option<Self> {
        Some(Self {
            from: *from,
            to: *to,
            duration_s,
            turn: turn(from, to)?,
        })
    }

    /// Returns the pose `time_s` after the first end.
    pub fn at(&self, time_s: f64) -> MovingPose {
        let Self {
            from,
            to,
            duration_s,
            turn,
        } = self;
        let mut place = [Vector3::zeros(); 3];
        let mut phi = [Vector3::zeros(); 3];
        // At its beginning a rotation vector's derivatives are those of the angle turned.
        let back = from.pose.rotation.inverse();
        let spin = [from.velocity, from.acceleration].map(|twist| back * twist.angular);
        let places = |end: &MovingPose| {
            [
                end.pose.translation.vector,
                end.velocity.linear,
                end.acceleration.linear,
            ]
        };
        let (start, end) = (places(from), places(to));
        for axis in 0..3 {
            let number = |orders: &[Vector3<f64>; 3]| orders.map(|order| order[axis]);
            let found = quintic(number(&start), number(&end), *duration_s, time_s);
            let first = [0.0, spin[0][axis], spin[1][axis]];
            let turned = quintic(first, number(turn), *duration_s, time_s);
            for order in 0..3 {
                place[order][axis] = found[order];
                phi[order][axis] = turned[order];
            }
        }
        let [phi, phi_1, phi_2] = phi;
        let jacobian = left_jacobian(&phi);
        let rotation = from.pose.rotation;
        MovingPose {
            pose: Isometry3::from_parts(
                Translation3::from(place[0]),
                rotation * UnitQuaternion::from_scaled_axis(phi),
            ),
            velocity: Twist {
                linear: place[1],
                angular: rotation * (jacobian * phi_1),
            },
            acceleration: Twist {
                linear: place[2],
                angular: rotation * (jacobian * phi_2 + left_jacobian_rate(&phi, &phi_1)),
            },
        }
    }
}

/// Returns position, velocity and acceleration, `time` after `from`, of the polynomial of fifth degree
/// that has these at `from` and, `duration` later, at `to` (Lynch and Park, *Modern Robotics*, 2017,
/// §9.2.2.2); those of `from` if no time is between them.
///
/// Times are in seconds, the other numbers in any unit, the unit per second and per second squared.
pub fn quintic(from: [f64; 3], to: [f64; 3], duration: f64, time: f64) -> [f64; 3] {
    if duration.is_nan() || duration <= 0.0 {
        return from;
    }
    let ([p0, v0, a0], [p1, v1, a1]) = (from, to);
    let (h, s) = (duration, time / duration);
    // What the parabola through the first end lacks at the second, in units of the duration.
    let way = p1 - p0 - v0 * h - 0.5 * a0 * h * h;
    let speed = (v1 - v0 - a0 * h) * h;
    let bend = (a1 - a0) * h * h;
    let c3 = 10.0 * way - 4.0 * speed + 0.5 * bend;
    let c4 = -15.0 * way + 7.0 * speed - bend;
    let c5 = 6.0 * way - 3.0 * speed + 0.5 * bend;
    let s2 = s * s;
    [
        p0 + v0 * time + 0.5 * a0 * time * time + s2 * s * (c3 + s * (c4 + s * c5)),
        v0 + a0 * time + s2 * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)) / h,
        a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5)) / (h * h),
    ]
}

/// Returns the rotation vector from one end to the other and its derivatives there.
///
/// The angular velocity along the first end's axes is `ω = J(φ) φ′`, its derivative `J φ″ + J′ φ′`
/// with the left Jacobian J of the rotation group; here they are solved for φ′ and φ″.
fn turn(from: &MovingPose, to: &MovingPose) -> Option<[Vector3<f64>; 3]> {
    let back = from.pose.rotation.inverse();
    let phi = (back * to.pose.rotation).scaled_axis();
    let [spin, spin_rate] = [to.velocity, to.acceleration].map(|twist| back * twist.angular);
    let inverse = left_jacobian(&phi).try_inverse()?;
    let velocity = inverse * spin;
    let acceleration = inverse * (spin_rate - left_jacobian_rate(&phi, &velocity));
    Some([phi, velocity, acceleration])
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
    use super::*;

    #[test]
    fn the_polynomial_has_both_ends_and_its_own_derivatives() {
        let (from, to, h) = ([0.2, -1.0, 3.0], [0.5, 2.0, -4.0], 0.3);
        for (time, expected) in [(0.0, from), (h, to)] {
            let found = quintic(from, to, h, time);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
        let step = 1e-5;
        for part in 1..10 {
            let time = h * f64::from(part) / 10.0;
            let [before, now, after] = [-step, 0.0, step].map(|d| quintic(from, to, h, time + d));
            for order in 0..2 {
                let slope = (after[order] - before[order]) / (2.0 * step);
                assert!((slope - now[order + 1]).abs() < 1e-6, "order {order}");
            }
        }
    }

    #[test]
    fn a_passage_has_both_ends_and_its_own_derivatives() {
        let end = |shift: f64| MovingPose {
            pose: Isometry3::new(
                Vector3::new(shift, 0.2, -0.1),
                Vector3::new(0.4, shift, -0.2),
            ),
            velocity: Twist::from_array([0.3, -0.2, shift, 0.5, -1.0, 0.7]),
            acceleration: Twist::from_array([1.0, shift, -2.0, 3.0, 0.5, -1.5]),
        };
        let (from, to, duration_s) = (end(0.1), end(0.6), 0.4);
        let passage = Passage::new(&from, &to, duration_s).unwrap();
        for (time_s, expected) in [(0.0, from), (duration_s, to)] {
            let found = passage.at(time_s);
            let off = found.pose.inv_mul(&expected.pose);
            assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7);
            let far = |a: Twist, b: Twist| {
                (a.linear - b.linear)
                    .norm()
                    .max((a.angular - b.angular).norm())
            };
            assert!(far(found.velocity, expected.velocity) < 1e-9);
            assert!(far(found.acceleration, expected.acceleration) < 1e-8);
        }
        let h = 1e-5;
        for part in 1..10 {
            let time_s = duration_s * f64::from(part) / 10.0;
            let [before, now, after] = [-h, 0.0, h].map(|d| passage.at(time_s + d));
            let turned = after.pose.rotation * before.pose.rotation.inverse();
            assert!((turned.scaled_axis() / (2.0 * h) - now.velocity.angular).norm() < 1e-6);
            let rate = (after.velocity.angular - before.velocity.angular) / (2.0 * h);
            assert!((rate - now.acceleration.angular).norm() < 1e-5);
            let rate = (after.velocity.linear - before.velocity.linear) / (2.0 * h);
            assert!((rate - now.acceleration.linear).norm() < 1e-5);
        }
    }
}
