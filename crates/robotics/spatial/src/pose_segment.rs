//! From one moving pose to the next, without a jump in place, velocity or acceleration.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::{Palm, Pose, QuinticSegment, Twist};

/// Below this angle in radians the series are more exact than the quotients.
const SMALL_RAD: f64 = 0.05;

/// State of a moving palm relative to `Frame`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseState<Frame> {
    /// The palm's pose.
    pub frame_from_palm: Pose<Frame, Palm>,
    /// Its velocity.
    pub velocity: Twist<Frame>,
    /// Its acceleration.
    pub acceleration: Twist<Frame>,
}

/// Greatest sizes of velocities and accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peaks {
    /// Speed of the origin in m/s.
    pub speed: f64,
    /// Its acceleration in m/s².
    pub acceleration: f64,
    /// Angular speed in rad/s.
    pub angular_speed: f64,
    /// Angular acceleration in rad/s².
    pub angular_acceleration: f64,
}

impl Peaks {
    /// Returns the peaks at rest.
    pub fn zero() -> Self {
        Self {
            speed: 0.0,
            acceleration: 0.0,
            angular_speed: 0.0,
            angular_acceleration: 0.0,
        }
    }
}

/// Largest excess of the bound of an angular speed or acceleration, relative to the greatest one.
const BOUND_TOLERANCE: f64 = 1e-4;
/// Maximum number of halvings of a segment.
const HALVINGS: u32 = 12;

/// The motion between two pose states: polynomials of fifth degree in time that have both ends'
/// positions, velocities and accelerations. The rotation is that of the first end turned by the
/// rotation vector that such a polynomial gives.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSegment<Frame> {
    from: PoseState<Frame>,
    to: PoseState<Frame>,
    duration_s: f64,
    /// The rotation vector from the first end to the second, in the first's moving frame, with its
    /// velocity and acceleration at the second.
    turn: [Vector3<f64>; 3],
}

impl<Frame: Copy> PoseSegment<Frame> {
    /// Takes two ends `duration_s` apart; `None` if no rotation vector follows the turn between them,
    /// which is then about a whole one.
    pub fn new(from: &PoseState<Frame>, to: &PoseState<Frame>, duration_s: f64) -> Option<Self> {
        Some(Self {
            from: *from,
            to: *to,
            duration_s,
            turn: turn(from, to)?,
        })
    }

    /// Returns the pose `time_s` after the first end.
    pub fn at(&self, time_s: f64) -> PoseState<Frame> {
        let Self {
            from,
            to,
            duration_s,
            turn,
        } = self;
        let mut place = [Vector3::zeros(); 3];
        let mut phi = [Vector3::zeros(); 3];
        let (start, end, first) = (places(from), places(to), spins(from));
        for axis in 0..3 {
            let number = |orders: &[Vector3<f64>; 3]| orders.map(|order| order[axis]);
            let found = quintic(number(&start), number(&end), *duration_s, time_s);
            let turned = quintic(number(&first), number(turn), *duration_s, time_s);
            for order in 0..3 {
                place[order][axis] = found[order];
                phi[order][axis] = turned[order];
            }
        }
        let [phi, phi_1, phi_2] = phi;
        let jacobian = left_jacobian(&phi);
        let rotation = from.frame_from_palm.rotation;
        PoseState {
            frame_from_palm: Pose::from_parts(
                place[0],
                rotation * UnitQuaternion::from_scaled_axis(phi),
            ),
            velocity: Twist::new(place[1], rotation * (jacobian * phi_1)),
            acceleration: Twist::new(
                place[2],
                rotation * (jacobian * phi_2 + left_jacobian_rate(&phi, &phi_1)),
            ),
        }
    }

    /// Returns the least and the greatest coordinates of the origin.
    pub fn range(&self) -> [Vector3<f64>; 2] {
        let (start, end) = (places(&self.from), places(&self.to));
        let mut range = [Vector3::zeros(); 2];
        for axis in 0..3 {
            let number = |orders: &[Vector3<f64>; 3]| orders.map(|order| order[axis]);
            let segment = QuinticSegment::new(number(&start), number(&end), self.duration_s);
            let [low, high] = segment.range();
            (range[0][axis], range[1][axis]) = (low, high);
        }
        range
    }

    /// Returns upper bounds of the speeds and accelerations, each at least that of `least`.
    ///
    /// Those of the origin are exact, as [`QuinticSegment`] has them;
    /// angular ones may be too large by a ten-thousandth.
    pub fn peaks(&self, least: &Peaks) -> Peaks {
        let place = QuinticSegment::new(places(&self.from), places(&self.to), self.duration_s);
        let turn = QuinticSegment::new(spins(&self.from), self.turn, self.duration_s);
        let [angular_speed, angular_acceleration] = self.turning(
            &turn,
            [0.0, self.duration_s],
            HALVINGS,
            [least.angular_speed, least.angular_acceleration],
        );
        Peaks {
            speed: place.max_speed(least.speed),
            acceleration: place.max_acceleration(least.acceleration),
            angular_speed,
            angular_acceleration,
        }
    }

    /// Returns the greatest angular speed and acceleration on a part of the segment, or those of `least`.
    ///
    /// The left Jacobian is the mean of the turns by r φ, `J = ∫ exp(r φ×) dr` over r from 0 to 1 (Barfoot,
    /// *State Estimation for Robotics*, 2017, §7.1.5), and `exp(r φ×)` turns with the angular velocity
    /// `∫ exp(s φ×) φ′ ds` over s from 0 to r, of which each `exp(s φ×) φ′` is at an angle of at most
    /// `(r − s) |φ|` to `exp(r φ×) φ′`. From that follow, with bounds F, V, A and B of φ, φ′, φ″ and φ‴ on
    /// the part:
    ///
    /// - the angular speed is at most V, the angular acceleration at most `A + min(V²/2, F V²/6)`;
    /// - the angular acceleration changes at no more than `B + 3/2 V A + V³/2`.
    ///
    /// A quantity that changes at a bounded rate is bounded by its value in the middle (Piyavskii, *An Algorithm
    /// for Finding the Absolute Extremum of a Function*, 1972).
    fn turning(
        &self,
        turn: &QuinticSegment<Vector3<f64>>,
        [from_s, to_s]: [f64; 2],
        halvings: u32,
        least: [f64; 2],
    ) -> [f64; 2] {
        let [f, v, a, b] = turn.hull(to_s - from_s);
        let middle_s = 0.5 * (from_s + to_s);
        let half_s = 0.5 * (to_s - from_s);
        let at = self.at(middle_s);
        let there = [at.velocity.angular.norm(), at.acceleration.angular.norm()];
        let change = a + (0.5 * v * v).min(f * v * v / 6.0);
        let bounds = [
            v.min(there[0] + half_s * change),
            change.min(there[1] + half_s * (b + 1.5 * v * a + 0.5 * v * v * v)),
        ];
        let least = [least[0].max(there[0]), least[1].max(there[1])];
        let is_known = |order: usize| bounds[order] <= least[order] * (1.0 + BOUND_TOLERANCE);
        // NaN has no bound.
        if halvings == 0 || is_known(0) && is_known(1) || bounds.iter().any(|b| !b.is_finite()) {
            return [0, 1].map(|order| {
                if bounds[order].is_finite() {
                    bounds[order].max(least[order])
                } else {
                    f64::INFINITY
                }
            });
        }
        let parts = turn.halves().into_iter();
        let times = [[from_s, middle_s], [middle_s, to_s]];
        parts.zip(times).fold(least, |least, (part, times)| {
            self.turning(&part, times, halvings - 1, least)
        })
    }
}

/// Returns the position of the origin and its derivatives.
fn places<Frame>(end: &PoseState<Frame>) -> [Vector3<f64>; 3] {
    [
        end.frame_from_palm.translation.vector,
        end.velocity.linear,
        end.acceleration.linear,
    ]
}

/// Returns the rotation vector at the beginning of a segment, where its derivatives are those of the angle
/// turned.
fn spins<Frame>(from: &PoseState<Frame>) -> [Vector3<f64>; 3] {
    let back = from.frame_from_palm.rotation.inverse();
    [
        Vector3::zeros(),
        back * from.velocity.angular,
        back * from.acceleration.angular,
    ]
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
    // Residual at the second end of the parabola through the first, in units of the duration.
    let rest = p1 - p0 - v0 * h - 0.5 * a0 * h * h;
    let speed = (v1 - v0 - a0 * h) * h;
    let bend = (a1 - a0) * h * h;
    let c3 = 10.0 * rest - 4.0 * speed + 0.5 * bend;
    let c4 = -15.0 * rest + 7.0 * speed - bend;
    let c5 = 6.0 * rest - 3.0 * speed + 0.5 * bend;
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
fn turn<Frame>(from: &PoseState<Frame>, to: &PoseState<Frame>) -> Option<[Vector3<f64>; 3]> {
    let back = from.frame_from_palm.rotation.inverse();
    let phi = (back * to.frame_from_palm.rotation).scaled_axis();
    let [spin, spin_rate] = [&to.velocity, &to.acceleration].map(|twist| back * twist.angular);
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
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    use super::*;
    use crate::World;

    fn twist(most: f64) -> impl Strategy<Value = Twist<World>> {
        prop::array::uniform6(-most..most).prop_map(Twist::from_array)
    }

    fn moving() -> impl Strategy<Value = PoseState<World>> {
        let pose = prop::array::uniform6(-1.0..1.0_f64);
        (pose, twist(4.0), twist(30.0)).prop_map(|([x, y, z, a, b, c], velocity, acceleration)| {
            PoseState {
                frame_from_palm: Pose::new(Isometry3::new(
                    Vector3::new(x, y, z),
                    Vector3::new(a, b, c),
                )),
                velocity,
                acceleration,
            }
        })
    }

    proptest! {
        /// No peak is passed, and each is reached within its tolerance.
        #[test]
        fn peaks_are_the_maxima_of_a_segment(
            from in moving(),
            to in moving(),
            duration_s in 0.02..1.0_f64,
        ) {
            let segment = PoseSegment::new(&from, &to, duration_s).unwrap();
            let found = segment.peaks(&Peaks::zero());
            let mut seen = Peaks::zero();
            let [low, high] = segment.range();
            for look in 0..=4000 {
                let at = segment.at(duration_s * f64::from(look) / 4000.0);
                let place = at.frame_from_palm.translation.vector;
                prop_assert!((place - low).min() > -1e-9 && (high - place).min() > -1e-9);
                seen = Peaks {
                    speed: seen.speed.max(at.velocity.linear.norm()),
                    acceleration: seen.acceleration.max(at.acceleration.linear.norm()),
                    angular_speed: seen.angular_speed.max(at.velocity.angular.norm()),
                    angular_acceleration: seen
                        .angular_acceleration
                        .max(at.acceleration.angular.norm()),
                };
            }
            let all = |p: Peaks| [p.speed, p.acceleration, p.angular_speed, p.angular_acceleration];
            for (found, seen) in all(found).into_iter().zip(all(seen)) {
                prop_assert!((1.0 - 1e-9..1.0 + 5e-3).contains(&(found / seen)), "{found} {seen}");
            }
            let twice = all(found).map(|peak| 2.0 * peak);
            let [speed, acceleration, angular_speed, angular_acceleration] = twice;
            let least = Peaks { speed, acceleration, angular_speed, angular_acceleration };
            for (found, twice) in all(segment.peaks(&least)).into_iter().zip(twice) {
                prop_assert!((1.0..=1.0 + BOUND_TOLERANCE).contains(&(found / twice)), "{found} {twice}");
            }
        }
    }

    #[test]
    fn polynomial_meets_both_ends_and_its_derivatives() {
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
    fn segment_meets_both_ends_and_its_derivatives() {
        let end = |shift: f64| PoseState {
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(shift, 0.2, -0.1),
                Vector3::new(0.4, shift, -0.2),
            )),
            velocity: Twist::from_array([0.3, -0.2, shift, 0.5, -1.0, 0.7]),
            acceleration: Twist::from_array([1.0, shift, -2.0, 3.0, 0.5, -1.5]),
        };
        let (from, to, duration_s) = (end(0.1), end(0.6), 0.4);
        let segment = PoseSegment::new(&from, &to, duration_s).unwrap();
        for (time_s, expected) in [(0.0, from), (duration_s, to)] {
            let found = segment.at(time_s);
            let off = found.frame_from_palm.inv_mul(&expected.frame_from_palm);
            assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7);
            let far = |a: Twist<World>, b: Twist<World>| {
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
            let [before, now, after] = [-h, 0.0, h].map(|d| segment.at(time_s + d));
            let turned = after.frame_from_palm.rotation * before.frame_from_palm.rotation.inverse();
            assert!((turned.scaled_axis() / (2.0 * h) - now.velocity.angular).norm() < 1e-6);
            let rate = (after.velocity.angular - before.velocity.angular) / (2.0 * h);
            assert!((rate - now.acceleration.angular).norm() < 1e-5);
            let rate = (after.velocity.linear - before.velocity.linear) / (2.0 * h);
            assert!((rate - now.acceleration.linear).norm() < 1e-5);
        }
    }
}
