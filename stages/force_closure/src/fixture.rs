//! What the tests share: the Allegro hand and a box on a table.

use std::{fs, sync::Arc};

use approach::HandBody;
use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use posture::{Environment, Hand};
use robot::RobotModel;
use spatial::RestingPose;

use crate::{ForceClosureConfig, contacts::Measure};

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.03, 0.06];

pub(crate) const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);
pub(crate) const TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/hands/allegro_right.toml"
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

/// Returns options with their defaults.
pub(crate) fn config() -> ForceClosureConfig {
    let value = serde_json::json!({
        "hand": URDF,
        "hand_table": TABLE,
        "flexion_joints": FLEXION,
    });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand as the solver and as the approach know it.
pub(crate) fn hand() -> (Hand, HandBody) {
    let model = RobotModel::from_urdf(&fs::read_to_string(URDF).unwrap()).unwrap();
    let body = HandBody::new(model.clone(), &FLEXION, GRASP_Q.to_vec()).unwrap();
    let table = fs::read_to_string(TABLE).unwrap().parse().unwrap();
    (Hand::new(model, &table).unwrap(), body)
}

/// Returns the box's distances.
pub(crate) fn field() -> DistanceField {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap()
}

/// Returns how the box lies.
pub(crate) fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    }
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    Environment::new(Arc::new(field()), rest())
}

/// Returns how the box's contacts are measured.
pub(crate) fn measure() -> Measure {
    Measure {
        center_in_object: Point3::origin(),
        length_m: 0.05,
        friction: 0.7,
        edges: 4,
    }
}
