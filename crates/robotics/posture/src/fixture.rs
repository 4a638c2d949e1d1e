//! Shared test fixtures: the Allegro hand and a box on a table.

use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use spatial::RestingPose;

use crate::Environment;

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

/// Path of the Allegro hand's URDF, from this crate.
pub(crate) const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../../data/robots/allegro_right.urdf"
);

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    let field = DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap();
    let rest = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    };
    Environment::new(field, rest)
}
