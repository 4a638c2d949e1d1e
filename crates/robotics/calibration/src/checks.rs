//! What measurements must be, each by itself and beside the others.

use nalgebra::{Isometry3, Point3};

use crate::{
    error::{CalibrationError, Field},
    hand_eye::PosePair,
    measurements::MAX_MEASUREMENTS,
    touched_points::PointPair,
};

/// Fewest measurements that determine a pose.
const LEAST_N: usize = 3;
/// Largest distance of a point or a frame from a robot's base or a camera, in meters: millimeters are more.
const LARGEST_M: f64 = 20.0;
/// Largest difference of numbers that are the same, in meters and radians.
const SAME: f64 = 1e-6;

pub(crate) fn check_count(n: usize) -> Result<(), CalibrationError> {
    match n {
        n if n < LEAST_N => Err(CalibrationError::TooFew { n }),
        n if n > MAX_MEASUREMENTS => Err(CalibrationError::TooMany { n }),
        _ => Ok(()),
    }
}

pub(crate) fn check_points(pairs: &[PointPair]) -> Result<(), CalibrationError> {
    let of = |point: fn(&PointPair) -> Point3<f64>| {
        let points = pairs.iter().map(point);
        points
            .map(|point| Isometry3::translation(point.x, point.y, point.z))
            .collect::<Vec<_>>()
    };
    let [base, camera] = [of(|it| it.in_base), of(|it| it.in_camera)];
    for (field, positions) in [(Field::InBase, &base), (Field::InCamera, &camera)] {
        check_finite(field, positions)?;
    }
    check_unit(Field::InBase, &base, Field::InCamera, &camera)?;
    check_distinct(Field::InBase, &base)?;
    check_distinct(Field::InCamera, &camera)
}

pub(crate) fn check_poses(pairs: &[PosePair]) -> Result<(), CalibrationError> {
    let flange: Vec<_> = pairs.iter().map(|it| *it.base_from_flange).collect();
    let board: Vec<_> = pairs.iter().map(|it| *it.camera_from_board).collect();
    for (field, poses) in [(Field::Flange, &flange), (Field::Board, &board)] {
        check_finite(field, poses)?;
    }
    check_unit(Field::Flange, &flange, Field::Board, &board)?;
    check_distinct(Field::Flange, &flange)?;
    check_distinct(Field::Board, &board)
}

fn check_finite(field: Field, poses: &[Isometry3<f64>]) -> Result<(), CalibrationError> {
    let is_finite = |pose: &Isometry3<f64>| {
        let [offset, rotation] = [pose.translation.vector.norm(), pose.rotation.coords.norm()];
        offset.is_finite() && rotation.is_finite()
    };
    match poses.iter().position(|pose| !is_finite(pose)) {
        Some(idx) => Err(CalibrationError::NotFinite {
            field,
            number: idx + 1,
        }),
        None => Ok(()),
    }
}

/// Refuses positions that are too far away for meters, in one of two fields or both.
fn check_unit(
    first: Field,
    first_poses: &[Isometry3<f64>],
    second: Field,
    second_poses: &[Isometry3<f64>],
) -> Result<(), CalibrationError> {
    let [first_m, second_m] = [first_poses, second_poses].map(|poses| {
        let distances = poses.iter().map(|pose| pose.translation.vector.norm());
        distances.fold(0.0, f64::max)
    });
    let (field, other, distance_m) = match (first_m > LARGEST_M, second_m > LARGEST_M) {
        (false, false) => return Ok(()),
        (true, false) => (first, None, first_m),
        (false, true) => (second, None, second_m),
        (true, true) => (first, Some(second), first_m.max(second_m)),
    };
    Err(CalibrationError::TooFar {
        field,
        other,
        distance_m,
    })
}

fn check_distinct(field: Field, poses: &[Isometry3<f64>]) -> Result<(), CalibrationError> {
    let is_same = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        (a.translation.vector - b.translation.vector).norm() < SAME
            && a.rotation.angle_to(&b.rotation) < SAME
    };
    for (idx, pose) in poses.iter().enumerate() {
        let earlier = poses.iter().take(idx);
        if let Some(first) = earlier.clone().position(|other| is_same(other, pose)) {
            return Err(CalibrationError::Twice {
                field,
                first: first + 1,
                second: idx + 1,
            });
        }
    }
    Ok(())
}
