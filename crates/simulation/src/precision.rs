//! The border between `f64` outside and the physics engine's `f32` inside.

use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use rapier3d::math::{Matrix, Pose as EnginePose, Real, Rotation, Vector};
use spatial::Pose;

/// Rounds to single precision.
#[expect(
    clippy::cast_possible_truncation,
    reason = "physics is single precision; overflow to infinity is caught as a divergence"
)]
pub(crate) fn real(number: f64) -> Real {
    number as Real
}

/// Rounds a vector.
pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(real(v.x), real(v.y), real(v.z))
}

/// Rounds a point.
pub(crate) fn point(p: &Point3<f64>) -> Vector {
    vector(&p.coords)
}

/// Rounds a rotation.
pub(crate) fn rotation(r: &UnitQuaternion<f64>) -> Rotation {
    let q = r.quaternion();
    Rotation::from_xyzw(real(q.i), real(q.j), real(q.k), real(q.w)).normalize()
}

/// Rounds a pose.
pub(crate) fn engine_pose<To, From>(pose: &Pose<To, From>) -> EnginePose {
    EnginePose::from_parts(vector(&pose.translation.vector), rotation(&pose.rotation))
}

/// Rounds a symmetric matrix.
pub(crate) fn matrix(m: &Matrix3<f64>) -> Matrix {
    Matrix::from_cols(
        vector(&m.column(0).into_owned()),
        vector(&m.column(1).into_owned()),
        vector(&m.column(2).into_owned()),
    )
}

/// Widens a pose; the caller names its frames.
pub(crate) fn pose_from_engine<To, From>(pose: &EnginePose) -> Pose<To, From> {
    let (t, r) = (pose.translation, pose.rotation);
    Pose::from_parts(
        [f64::from(t.x), f64::from(t.y), f64::from(t.z)],
        UnitQuaternion::from_quaternion(Quaternion::from_parts(
            f64::from(r.w),
            Vector3::new(f64::from(r.x), f64::from(r.y), f64::from(r.z)),
        )),
    )
}
