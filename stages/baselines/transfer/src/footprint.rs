//! The box of an object on the table.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix2, Point3, SymmetricEigen, UnitQuaternion, Vector2, Vector3};
use spatial::{Object, Pose, RestingPose, Table};

/// Rounding of an angle, in radians.
const ROUNDING: f64 = 1e-6;

/// The frame of an object's box on the table: its origin at the box's center, z up, x along the longer spread of the
/// object's points in the table's plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Footprint {}

/// Returns the frame of an object's box in the object's own, from points on its surface (m); `None` without points.
///
/// The axis is that of the larger variance in the plane, up to half a turn: of the two, the one whose yaw is in (-90°,
/// 90°] on the table. An object as wide as it is long has no such axis, and any serves.
pub(crate) fn object_from_footprint(
    points: &[[f64; 3]],
    rest: &RestingPose,
) -> Option<Pose<Object, Footprint>> {
    let table_from_object = rest.table_from_object();
    let on_table: Vec<Point3<f64>> = points
        .iter()
        .map(|&point| table_from_object.transform_point(&Point3::from(point)))
        .collect();
    let first = on_table.first()?.xy().coords;
    let mean = on_table.iter().fold(Vector2::zeros(), |sum, point| {
        sum + point.xy().coords - first
    }) / on_table.len() as f64
        + first;
    let covariance = on_table.iter().fold(Matrix2::zeros(), |sum, point| {
        let off = point.xy().coords - mean;
        sum + off * off.transpose()
    });
    let eigen = SymmetricEigen::new(covariance);
    let longer = usize::from(eigen.eigenvalues[0] < eigen.eigenvalues[1]);
    let axis = eigen.eigenvectors.column(longer).into_owned();
    let yaw = axis.y.atan2(axis.x);
    // Within rounding of a quarter turn, either side of it is the same quarter turn.
    let yaw = if yaw > FRAC_PI_2 + ROUNDING {
        yaw - PI
    } else if yaw < -FRAC_PI_2 + ROUNDING {
        yaw + PI
    } else {
        yaw
    };
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let turned = on_table
        .iter()
        .map(|point| turn.inverse_transform_vector(&point.coords));
    let (least, most) = turned.fold(
        (
            Vector3::repeat(f64::INFINITY),
            Vector3::repeat(f64::NEG_INFINITY),
        ),
        |(least, most), point| (least.inf(&point), most.sup(&point)),
    );
    let center = turn * ((least + most) / 2.0);
    let table_from_footprint: Pose<Table, Footprint> = Pose::from_parts(center, turn);
    Some(table_from_object.inverse() * table_from_footprint)
}

/// Returns the sides of the box along the object's own axes, in meters, longest first; `None` without points.
pub(crate) fn sides(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    points.first()?;
    let mut sides = [0, 1, 2].map(|axis| {
        let along = points.iter().map(|point| point[axis]);
        let (least, most) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), at| {
            (least.min(at), most.max(at))
        });
        most - least
    });
    sides.sort_by(|a, b| b.total_cmp(a));
    Some(sides)
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    /// Corners of a box of these sides about a center.
    fn corners(center: [f64; 3], sides: [f64; 3]) -> Vec<[f64; 3]> {
        let at = |bits: usize| {
            [0, 1, 2].map(|k| center[k] + sides[k] * (((bits >> k) & 1) as f64 - 0.5))
        };
        (0..8).map(at).collect()
    }

    #[test]
    fn a_lying_box_has_its_long_side_along_x_and_its_center_at_the_origin() {
        // It lies on the side that its own x points to; its longest side, 0.3 m, is its own z.
        let points = corners([0.01, 0.02, 0.03], [0.1, 0.2, 0.3]);
        let rest = RestingPose {
            up_in_object: Unit::new_normalize(-Vector3::x()),
            height_m: 0.06,
        };
        let frame = object_from_footprint(&points, &rest).unwrap();
        assert!((frame.translation.vector - Vector3::new(0.01, 0.02, 0.03)).norm() < 1e-12);
        let x = frame.rotation * Vector3::x();
        assert!(x.z.abs() > 1.0 - 1e-12, "{x}");
        let z = frame.rotation * Vector3::z();
        assert!((z - -Vector3::x()).norm() < 1e-12, "{z}");
        assert_eq!(
            sides(&points).unwrap().map(|side| (side * 1e3).round()),
            [300.0, 200.0, 100.0]
        );
    }

    #[test]
    fn nothing_has_no_box() {
        let rest = RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: 0.0,
        };
        assert_eq!(object_from_footprint(&[], &rest), None);
        assert_eq!(sides(&[]), None);
    }
}
