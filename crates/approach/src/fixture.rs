//! What the tests share: the Allegro hand and a box on a table.

use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use posture::Environment;
use robot::RobotModel;
use schemas::objects::Object;
use spatial::RestingPose;

use crate::HandBody;

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.025, 0.08, 0.05];

const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);

/// Joints that bend the Allegro's fingers.
pub(crate) const FLEXION: [&str; 11] = [
    "joint_1.0",
    "joint_2.0",
    "joint_3.0",
    "joint_5.0",
    "joint_6.0",
    "joint_7.0",
    "joint_9.0",
    "joint_10.0",
    "joint_11.0",
    "joint_14.0",
    "joint_15.0",
];

/// A grasp with the thumb before the fingers.
pub(crate) const GRASP_Q: [f64; 16] = [
    0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 0.0, 0.7, 0.6, 0.5, 1.2, 0.2, 0.5, 0.5,
];

pub(crate) fn model() -> RobotModel {
    RobotModel::from_urdf(&std::fs::read_to_string(URDF).unwrap()).unwrap()
}

pub(crate) fn body() -> HandBody {
    HandBody::new(model(), &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// The box on its table.
pub(crate) fn environment() -> Environment {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    let field = DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap();
    Environment::new(field, rest())
}

pub(crate) fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    }
}

/// The box as an object without resting poses.
pub(crate) fn object() -> Object {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    Object {
        name: "box".to_owned(),
        mass_kg: 0.3,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [0.0; 6],
        points_m: Vec::new(),
        normals: Vec::new(),
        watertight: true,
        mirror: None,
        vertices_m: mesh
            .vertices_m
            .iter()
            .map(|vertex| (*vertex).into())
            .collect(),
        triangles: mesh.triangles,
        parts_m: Vec::new(),
        rests: Vec::new(),
    }
}
