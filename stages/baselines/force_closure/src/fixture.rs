//! Fixtures of the tests: a box on a table and a hand that grasps it.

use approach::HandBody;
use grasp_fixture::{FLEXION, GRASP_Q, HAND_TABLE, StandingBox, URDF};
use nalgebra::Point3;
use posture::Hand;
use schemas::trajectories::Trajectory;

use crate::ForceClosureConfig;

/// The box.
pub(crate) const BOX: StandingBox = StandingBox {
    half_m: [0.03, 0.03, 0.06],
};

/// Returns options with their defaults.
pub(crate) fn config() -> ForceClosureConfig {
    let value = serde_json::json!({
        "hand": URDF,
        "hand_table": HAND_TABLE,
        "flexion_joints": FLEXION,
    });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand as the solver and as the approach know it.
pub(crate) fn hand() -> (Hand, HandBody) {
    let model = grasp_fixture::hand();
    let body = HandBody::new(model.clone(), &FLEXION, GRASP_Q.to_vec()).unwrap();
    let table = hand_files::load_table(HAND_TABLE.as_ref()).unwrap();
    (Hand::new(model, &table).unwrap(), body)
}

/// Returns the parameters of the box's contacts.
pub(crate) fn contact_model() -> approach::ContactModel {
    approach::ContactModel {
        center_in_object: Point3::origin(),
        length_m: 0.05,
        friction: 0.7,
        edges: 4,
    }
}

/// Returns the trajectories that the stage reads.
pub(crate) fn trajectories() -> Vec<Trajectory> {
    ["a", "b"]
        .map(|sequence| BOX.reached(sequence, &GRASP_Q, 0.0))
        .into()
}
