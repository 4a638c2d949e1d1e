//! Velocity and acceleration of a hand, from derivatives of the network's outputs.

use motion::HandState;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use spatial::{Pose, Table, Twist};

use crate::hand_numbers::PALM_WIDTH;

/// State, velocity and acceleration of a hand at one time of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct HandMotionState<F = Table> {
    /// Pose of the palm and joint positions.
    pub grasp: HandState<F>,
    /// First derivative with respect to the network's time t.
    pub velocity: HandDerivative<F>,
    /// Second derivative with respect to t.
    pub acceleration: HandDerivative<F>,
}

/// A first or second derivative of a [`HandState`] with respect to the network's time t, which runs from 1
/// (far) to 0 (the grasp).
#[derive(Debug, Clone, PartialEq)]
pub struct HandDerivative<F = Table> {
    /// Of the palm, in meters and radians per unit of t (or its square).
    pub palm: Twist<F>,
    /// Of the joint positions, in radians per unit of t (or its square).
    pub q: Vec<f64>,
}

impl<F> HandMotionState<F> {
    /// Returns the same hand in another frame, which does not move in the first.
    pub(crate) fn expressed_in<G>(self, other_from_frame: &Pose<G, F>) -> HandMotionState<G> {
        let along = |rate: HandDerivative<F>| HandDerivative {
            palm: rate.palm.expressed_in(other_from_frame),
            q: rate.q,
        };
        HandMotionState {
            grasp: self.grasp.expressed_in(other_from_frame),
            velocity: along(self.velocity),
            acceleration: along(self.acceleration),
        }
    }
}

/// A vector that moves: value, first and second derivative.
type Moving = [Vector3<f64>; 3];

/// Reads a hand's numbers, their first and their second derivatives; `None` if the rotation is none.
pub(super) fn moving_grasp<F>(numbers: &[Vec<f64>; 3]) -> Option<HandMotionState<F>> {
    let vector = |at: usize| -> Option<Moving> {
        let mut parts = [Vector3::zeros(); 3];
        for (part, numbers) in parts.iter_mut().zip(numbers) {
            *part = Vector3::from_column_slice(numbers.get(at..at + 3)?);
        }
        Some(parts)
    };
    let [position, velocity, acceleration] = vector(0)?;
    let frame = frame(&vector(3)?, &vector(6)?)?;
    let [spin, spin_rate] = spin(&frame);
    let matrix = Matrix3::from_columns(&frame.map(|axis| axis[0]));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let q = |order: usize| numbers[order].get(PALM_WIDTH..).map(<[f64]>::to_vec);
    let rate = |linear: Vector3<f64>, angular: Vector3<f64>, order: usize| {
        let (palm, q) = (Twist::new(linear, angular), q(order)?);
        let is_finite = palm.is_finite() && q.iter().all(|x| x.is_finite());
        is_finite.then_some(HandDerivative { palm, q })
    };
    Some(HandMotionState {
        grasp: HandState {
            frame_from_palm: Pose::from_parts(position, rotation),
            q_rad: q(0)?,
        },
        velocity: rate(velocity, spin, 1)?,
        acceleration: rate(acceleration, spin_rate, 2)?,
    })
}

/// Returns the three axes of the rotation that Gram-Schmidt makes of two columns (Zhou et al., *On the
/// Continuity of Rotation Representations in Neural Networks*, 2019, §B), differentiated step by step.
fn frame(first: &Moving, second: &Moving) -> Option<[Moving; 3]> {
    let x = unit(first)?;
    let along = dot(&x, second);
    let y = unit(&minus(second, &scaled(&x, &along)))?;
    let z = cross(&x, &y);
    Some([x, y, z])
}

/// Returns the angular velocity and acceleration of a frame: each axis e turns by e′ = ω × e, so the
/// sum of e × e′ is 2 ω, and its derivative the sum of e × e″.
fn spin(frame: &[Moving; 3]) -> [Vector3<f64>; 2] {
    [1, 2].map(|order| {
        let sum: Vector3<f64> = frame.iter().map(|axis| axis[0].cross(&axis[order])).sum();
        sum / 2.0
    })
}

/// Returns a vector over its length; `None` if that is about zero or no number.
fn unit(v: &Moving) -> Option<Moving> {
    const MIN_NORM: f64 = 1e-9;
    let length = v[0].norm();
    if !(length.is_finite() && length > MIN_NORM) {
        return None;
    }
    let first = v[0].dot(&v[1]) / length;
    let second = (v[1].norm_squared() + v[0].dot(&v[2]) - first * first) / length;
    // From v = length · e, differentiated twice.
    let e = v[0] / length;
    let e_1 = (v[1] - e * first) / length;
    let e_2 = (v[2] - e_1 * (2.0 * first) - e * second) / length;
    Some([e, e_1, e_2])
}

fn dot(a: &Moving, b: &Moving) -> [f64; 3] {
    [
        a[0].dot(&b[0]),
        a[1].dot(&b[0]) + a[0].dot(&b[1]),
        a[2].dot(&b[0]) + 2.0 * a[1].dot(&b[1]) + a[0].dot(&b[2]),
    ]
}

fn cross(a: &Moving, b: &Moving) -> Moving {
    [
        a[0].cross(&b[0]),
        a[1].cross(&b[0]) + a[0].cross(&b[1]),
        a[2].cross(&b[0]) + a[1].cross(&b[1]) * 2.0 + a[0].cross(&b[2]),
    ]
}

fn scaled(a: &Moving, by: &[f64; 3]) -> Moving {
    [
        a[0] * by[0],
        a[1] * by[0] + a[0] * by[1],
        a[2] * by[0] + a[1] * (2.0 * by[1]) + a[0] * by[2],
    ]
}

fn minus(a: &Moving, b: &Moving) -> Moving {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
