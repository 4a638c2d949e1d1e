//! What the tests share: the Allegro hand and a box on a table.

use std::sync::Arc;

use approach::HandBody;
use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use posture::Environment;
use robot::RobotModel;
use spatial::RestingPose;

use crate::{EigengraspConfig, basis::Basis};

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.03, 0.08];

const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);

/// Joints that bend the Allegro's fingers.
const FLEXION: [&str; 11] = [
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
pub(crate) fn config() -> EigengraspConfig {
    let value = serde_json::json!({ "hand": URDF, "flexion_joints": FLEXION });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn body() -> HandBody {
    let model = RobotModel::from_urdf(&std::fs::read_to_string(URDF).unwrap()).unwrap();
    HandBody::new(model, &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// Returns two eigengrasps: all fingers bend, and the thumb turns.
pub(crate) fn basis() -> Basis {
    let along = |joints: &[usize], rad: f64| {
        let mut all = vec![0.0; 16];
        for &joint in joints {
            all[joint] = rad;
        }
        all
    };
    Basis {
        mean: GRASP_Q.to_vec(),
        eigengrasps: vec![
            along(&[1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15], 0.2),
            along(&[12], 0.1),
        ],
        explained: 0.9,
    }
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    let high = Point3::from(BOX_HALF_M);
    let mesh = TriMesh::cuboid(-high, high);
    let field = DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap();
    let rest = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    };
    Environment::new(Arc::new(field), rest)
}
