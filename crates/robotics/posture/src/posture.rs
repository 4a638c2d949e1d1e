//! Posture of a hand: the pose of its root and its joint positions.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use spatial::{Object, Palm, Pose};

use crate::trig::{LANES, sin_cos};

/// Pose of the hand's root and its joint positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    /// Pose of the root link in the object's frame.
    pub root: RootPose,
    /// One position per joint in the model's order, radians (meters if prismatic).
    pub q: Vec<f64>,
}

/// A pose of the hand's root link in the object's frame, as a matrix and as angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RootPose {
    pub(crate) translation: Vector3<f64>,
    pub(crate) rotation: Matrix3<f64>,
    /// Turns about x, then the new y, then the new z. Kept by [`crate::Root::Angles`] alone.
    pub(crate) angles: Vector3<f64>,
    /// The second angle's axis: y after the first turn.
    pub(crate) second_axis: Vector3<f64>,
}

impl Posture {
    /// Returns a posture from a pose and joint positions.
    pub fn new(object_from_palm: &Pose<Object, Palm>, q: Vec<f64>) -> Self {
        Self {
            root: RootPose::from_pose(object_from_palm),
            q,
        }
    }
}

impl RootPose {
    /// Returns the pose at the object's origin.
    pub fn identity() -> Self {
        Self {
            translation: Vector3::zeros(),
            rotation: Matrix3::identity(),
            angles: Vector3::zeros(),
            second_axis: Vector3::y(),
        }
    }

    /// Returns the root pose of this transform. Its angles are those with the middle one within a
    /// quarter turn.
    pub fn from_pose(object_from_palm: &Pose<Object, Palm>) -> Self {
        let rotation = object_from_palm.rotation.to_rotation_matrix().into_inner();
        let first = (-rotation[(1, 2)]).atan2(rotation[(2, 2)]);
        let middle = rotation[(0, 2)].clamp(-1.0, 1.0).asin();
        let last = (-rotation[(0, 1)]).atan2(rotation[(0, 0)]);
        Self {
            translation: object_from_palm.translation.vector,
            rotation,
            angles: Vector3::new(first, middle, last),
            second_axis: Vector3::new(0.0, first.cos(), first.sin()),
        }
    }

    /// Returns the root pose at a translation (m), turned about x, then about the new y, then about
    /// the new z (rad).
    pub fn from_angles(translation: Vector3<f64>, angles: Vector3<f64>) -> Self {
        let (mut sines, mut cosines) = ([0.0; LANES], [0.0; LANES]);
        sin_cos(
            &[angles.x, angles.y, angles.z, 0.0],
            &mut sines,
            &mut cosines,
        );
        let ([sa, sb, sc, _], [ca, cb, cc, _]) = (sines, cosines);
        let rotation = Matrix3::new(
            cb * cc,
            -cb * sc,
            sb,
            ca * sc + sa * sb * cc,
            ca * cc - sa * sb * sc,
            -sa * cb,
            sa * sc - ca * sb * cc,
            sa * cc + ca * sb * sc,
            ca * cb,
        );
        Self {
            translation,
            rotation,
            angles,
            second_axis: Vector3::new(0.0, ca, sa),
        }
    }

    /// Returns the transform.
    pub fn pose(&self) -> Pose<Object, Palm> {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Pose::from_parts(
            self.translation,
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// Returns the position of the root's origin in the object's frame, in meters.
    pub fn translation(&self) -> Vector3<f64> {
        self.translation
    }

    /// Returns the turns about x, the new y and the new z, in radians: those it was made with, or
    /// that a hand with [`crate::Root::Angles`] was moved to.
    pub fn angles(&self) -> Vector3<f64> {
        self.angles
    }

    /// Moves the root along the object's axes (m) and turns it about them in place (rad).
    ///
    /// The turn is the exponential map at the present orientation, so that no orientation is
    /// special.
    pub(crate) fn turned(&self, along: Vector3<f64>, turn: Vector3<f64>) -> Self {
        let rotation = exponential(&turn) * self.rotation;
        Self {
            translation: self.translation + along,
            rotation: orthonormal(&rotation),
            angles: self.angles,
            second_axis: self.second_axis,
        }
    }
}

/// Returns the rotation by a vector's length about its direction (Rodrigues).
fn exponential(turn: &Vector3<f64>) -> Matrix3<f64> {
    let squared = turn.norm_squared();
    let (first, second) = if squared < 1e-8 {
        (1.0 - squared / 6.0, 0.5 - squared / 24.0)
    } else {
        let angle = squared.sqrt();
        let (mut sine, mut cosine) = ([0.0], [0.0]);
        sin_cos(&[angle], &mut sine, &mut cosine);
        (sine[0] / angle, (1.0 - cosine[0]) / squared)
    };
    let cross = turn.cross_matrix();
    Matrix3::identity() + cross * first + cross * cross * second
}

/// Returns a vector whose length is the angle and whose direction is the axis of a rotation.
pub(crate) fn logarithm(rotation: &Matrix3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation)).scaled_axis()
}

/// Returns a nearly orthonormal matrix freed of its rounding errors (one step of Newton's method
/// for the polar factor; Higham, *Functions of Matrices*, 2008, §8.3).
fn orthonormal(rotation: &Matrix3<f64>) -> Matrix3<f64> {
    let gram = rotation.transpose() * rotation;
    rotation * (Matrix3::identity() * 1.5 - gram * 0.5)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn angles_and_matrix_are_one_rotation(a in -3.0..3.0, b in -1.5..1.5, c in -3.0..3.0) {
            let angles = Vector3::new(a, b, c);
            let root = RootPose::from_angles(Vector3::zeros(), angles);
            let turns = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
                * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
                * Rotation3::from_axis_angle(&Vector3::z_axis(), c);
            prop_assert!((root.rotation - turns.into_inner()).norm() < 1e-12);
            let again = RootPose::from_pose(&root.pose());
            prop_assert!((again.angles - angles).norm() < 1e-9, "{:?}", again.angles);
        }

        #[test]
        fn turning_is_the_exponential_map(turn in prop::array::uniform3(-3.0..3.0)) {
            let turn = Vector3::from(turn);
            let root = RootPose::identity().turned(Vector3::x(), turn);
            let expected = Rotation3::new(turn).into_inner();
            prop_assert!((root.rotation - expected).norm() < 1e-12);
            prop_assume!(turn.norm() < 3.1);
            prop_assert!((logarithm(&root.rotation) - turn).norm() < 1e-7);
        }
    }
}
