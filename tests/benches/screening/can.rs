//! A soup can.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Vector3};
use simulation::ObjectShape;
use spatial::RestingPose;

const RADIUS_M: f64 = 0.034;
const HEIGHT_M: f64 = 0.102;
const MASS_KG: f64 = 0.349;

/// The can about its center: a hull of 32 vertices.
pub(crate) fn can() -> ObjectShape {
    let rim = (0..16).map(|idx| TAU * f64::from(idx) / 16.0);
    let points = rim
        .flat_map(|angle| {
            let (sin, cos) = angle.sin_cos();
            [-0.5, 0.5].map(|end| Point3::new(RADIUS_M * cos, RADIUS_M * sin, end * HEIGHT_M))
        })
        .collect();
    let across = MASS_KG * (3.0 * RADIUS_M.powi(2) + HEIGHT_M.powi(2)) / 12.0;
    let along = MASS_KG * RADIUS_M.powi(2) / 2.0;
    ObjectShape {
        surface: None,
        parts_m: vec![points],
        mass_kg: MASS_KG,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::from_diagonal(&Vector3::new(across, across, along)),
    }
}

/// The can stands.
pub(crate) fn upright() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: HEIGHT_M / 2.0,
    }
}
