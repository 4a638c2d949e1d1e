//! The one place where points become single precision for `parry3d`, and come back.

use nalgebra::Point3;
use parry3d::math::Vector;

/// Returns a point in single precision.
#[expect(
    clippy::cast_possible_truncation,
    reason = "parry3d computes in f32; 1e-8 m is lost"
)]
pub(crate) fn single(point: &Point3<f64>) -> Vector {
    Vector::new(point.x as f32, point.y as f32, point.z as f32)
}

/// Returns points in single precision.
pub(crate) fn singles(points: &[Point3<f64>]) -> Vec<Vector> {
    points.iter().map(single).collect()
}

/// Returns a point in double precision.
pub(crate) fn double(point: &Vector) -> Point3<f64> {
    Point3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z))
}
