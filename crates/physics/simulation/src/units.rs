//! The border between SI units in `f64` outside and the physics engine's units in `f32` inside.
//!
//! The engine computes in centimeters: its collision detection has absolute tolerances that were chosen
//! for shapes of a unit's size. Told of the parts of a mug in meters, it takes triangles of less than
//! 33 mm by 33 mm for lines, and reports fingertips 25 mm deep in walls that they touch. The unit of mass
//! is such that energies stay in joules: so do torques in newton meters, and inertias in kg m². The unit of
//! force is 100 N.

use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use rapier3d::math::{Matrix, Pose as EnginePose, Real, Rotation, Vector};
use spatial::Pose;

/// The engine's units of length in a meter.
pub(crate) const LENGTH_UNITS_PER_M: f64 = 100.0;

/// Rounds a number whose unit the engine shares: seconds, radians, newton meters, kg m².
#[expect(
    clippy::cast_possible_truncation,
    reason = "physics is single precision; overflow to infinity is caught as a divergence"
)]
pub(crate) fn real(number: f64) -> Real {
    number as Real
}

/// Converts a length in meters, a speed in m/s or an acceleration in m/s².
pub(crate) fn length(length_m: f64) -> Real {
    real(length_m * LENGTH_UNITS_PER_M)
}

/// Converts a mass in kilograms.
pub(crate) fn mass(mass_kg: f64) -> Real {
    real(mass_kg / LENGTH_UNITS_PER_M.powi(2))
}

/// Converts a stiffness in N/m, or a damping in N s/m.
#[cfg(test)]
pub(crate) fn linear_stiffness(newtons_per_m: f64) -> Real {
    real(newtons_per_m / LENGTH_UNITS_PER_M.powi(2))
}

/// Converts a vector of lengths in meters, of speeds in m/s or of accelerations in m/s².
pub(crate) fn lengths(v: &Vector3<f64>) -> Vector {
    vector(&(v * LENGTH_UNITS_PER_M))
}

/// Converts a point in meters.
pub(crate) fn point(p: &Point3<f64>) -> Vector {
    lengths(&p.coords)
}

/// Rounds a vector whose unit the engine shares.
pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(real(v.x), real(v.y), real(v.z))
}

/// Rounds a rotation.
pub(crate) fn rotation(r: &UnitQuaternion<f64>) -> Rotation {
    let q = r.quaternion();
    Rotation::from_xyzw(real(q.i), real(q.j), real(q.k), real(q.w)).normalize()
}

/// Converts a pose in meters.
pub(crate) fn engine_pose<To, From>(pose: &Pose<To, From>) -> EnginePose {
    EnginePose::from_parts(lengths(&pose.translation.vector), rotation(&pose.rotation))
}

/// Rounds a symmetric matrix whose unit the engine shares.
pub(crate) fn matrix(m: &Matrix3<f64>) -> Matrix {
    Matrix::from_cols(
        vector(&m.column(0).into_owned()),
        vector(&m.column(1).into_owned()),
        vector(&m.column(2).into_owned()),
    )
}

/// Returns a length of the engine in meters, a speed in m/s.
pub(crate) fn meters(length: Real) -> f64 {
    f64::from(length) / LENGTH_UNITS_PER_M
}

/// Returns a force of the engine in newtons.
pub(crate) fn forces_in_newtons(force: &Vector3<f64>) -> Vector3<f64> {
    force * LENGTH_UNITS_PER_M
}

/// Returns lengths of the engine in meters, speeds in m/s.
pub(crate) fn vector_in_meters(v: Vector) -> Vector3<f64> {
    Vector3::from(v.to_array().map(meters))
}

/// The coordinates in which the engine computes: along the table's axes, and moving over it while a palm is
/// lifted ([`crate::world::World::carry`]).
pub(crate) enum EngineFrame {}

/// Returns the pose of a frame that the caller names, in meters.
pub(crate) fn pose_from_engine<From>(pose: &EnginePose) -> Pose<EngineFrame, From> {
    let r = pose.rotation;
    Pose::from_parts(
        vector_in_meters(pose.translation),
        UnitQuaternion::from_quaternion(Quaternion::from_parts(
            f64::from(r.w),
            Vector3::new(f64::from(r.x), f64::from(r.y), f64::from(r.z)),
        )),
    )
}
