//! What the tests share: the Allegro hand and a box on a table.

use std::{
    fs,
    sync::{Arc, OnceLock},
};

use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use posture::{Environment, Hand};
use robot::RobotModel;
use spatial::RestingPose;

use crate::RefineConfig;

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);
const TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/hands/allegro_right.toml"
);

/// Returns options with their defaults.
pub(crate) fn config() -> RefineConfig {
    let options = [("hand", URDF), ("hand_table", TABLE)];
    let options = options.map(|(key, path)| (key.to_owned(), path.into()));
    serde_json::from_value(serde_json::Value::Object(options.into_iter().collect())).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn hand() -> Hand {
    let model = RobotModel::from_urdf(&fs::read_to_string(URDF).unwrap()).unwrap();
    Hand::new(model, &fs::read_to_string(TABLE).unwrap().parse().unwrap()).unwrap()
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    static FIELD: OnceLock<Arc<DistanceField>> = OnceLock::new();
    let field = FIELD.get_or_init(|| {
        let high = Point3::from(BOX_HALF_M);
        let mesh = TriMesh::cuboid(-high, high);
        Arc::new(DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap())
    });
    let rest = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    };
    Environment::new(Arc::clone(field), rest)
}
