//! Test fixtures: the Allegro hand, its correspondences and a box on a table.

use std::sync::OnceLock;

use geometry::{DistanceField, TriMesh};
use nalgebra::{Point3, Vector3};
use posture::{Environment, Hand, HandTable, NoTerms, Posture, Solver, Task};
use robot::RobotModel;
use schemas::{
    demonstrations::{Demonstration, KEYPOINTS, Side, Step},
    distance_fields::FieldInfo,
};
use spatial::RestingPose;

use crate::{Loss, RetargetConfig, Wrist, settle::put_down, survey::survey};

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

/// Path of the Allegro hand's URDF, from this crate.
pub(crate) const URDF: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);

/// Path of its table, from this crate.
pub(crate) const TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/hands/allegro_right.toml"
);

/// Returns options with every term on.
pub(crate) fn config() -> RetargetConfig {
    RetargetConfig {
        hand: URDF.into(),
        hand_table: TABLE.into(),
        wrist: Wrist::Free,
        loss: Loss::Squared,
        smooth_l1_beta_m: 0.02,
        smoothing_s: 0.0,
        smoothness_weight: 0.2,
        joint_smoothness_weight: 0.02,
        object_weight: 3.0,
        clearance_m: 0.008,
        closing_time_s: 0.3,
        table_weight: 3.0,
        table_margin_m: 0.002,
        contact_weight: 3.0,
        contact_distance_m: 0.015,
        contact_position_factor: 0.3,
        field_spacing_m: 0.0025,
        max_iterations: 40,
        max_keypoint_error_m: 0.05,
    }
}

/// Returns options with nothing but the paper's first term.
pub(crate) fn following_only() -> RetargetConfig {
    RetargetConfig {
        smoothness_weight: 0.0,
        joint_smoothness_weight: 0.0,
        object_weight: 0.0,
        table_weight: 0.0,
        contact_weight: 0.0,
        ..config()
    }
}

/// Returns the table of the Allegro hand, at the person's size.
pub(crate) fn table() -> HandTable {
    let table = hand_files::load_table(TABLE.as_ref()).unwrap();
    HandTable {
        scale: 1.0,
        ..table
    }
}

/// Returns the Allegro hand.
pub(crate) fn hand() -> Hand {
    let model = RobotModel::from_urdf(&std::fs::read_to_string(URDF).unwrap()).unwrap();
    Hand::new(model, &table()).unwrap()
}

/// Returns a box about the origin.
pub(crate) fn mesh() -> TriMesh {
    let high = Point3::from(BOX_HALF_M);
    TriMesh::cuboid(-high, high)
}

/// Returns how the box stands.
pub(crate) fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    }
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    static SURVEYED: OnceLock<(DistanceField, FieldInfo)> = OnceLock::new();
    let (field, info) = SURVEYED.get_or_init(|| survey(&mesh(), 0.0025).unwrap().unwrap());
    put_down(field.clone(), info, &rest())
}

/// Returns what a person's landmarks would be if the person had the robot's hand at a posture.
pub(crate) fn own_points(hand: &Hand, posture: &Posture) -> [[f64; 3]; KEYPOINTS] {
    let mut solver = Solver::new(&hand.compiled);
    let nothing = Task {
        targets: &[],
        loss: posture::Loss::Squared,
        smoothness: None,
        prior: None,
    };
    solver.place(&nothing, posture, &mut NoTerms).unwrap();
    let mut keypoints = [[0.0; 3]; KEYPOINTS];
    for (idx, point) in hand.points.iter().enumerate() {
        keypoints[point.keypoint] = solver.posed().point(idx).unwrap().into();
    }
    keypoints
}

/// Returns a demonstration towards the box that shows these landmarks, 30 times per second.
pub(crate) fn demonstration(keypoints: Vec<[[f64; 3]; KEYPOINTS]>) -> Demonstration {
    Demonstration {
        sequence: "s".to_owned(),
        object: "box".to_owned(),
        subject: "p".to_owned(),
        hand: Side::Right,
        mirrored: false,
        start_reason: String::new(),
        end_reason: String::new(),
        rest: rest(),
        steps: keypoints
            .into_iter()
            .zip(0_u32..)
            .map(|(keypoints_m, image)| Step {
                image,
                time_s: f64::from(image) / 30.0,
                cameras_n: 1,
                bridged: false,
                keypoints_m,
            })
            .collect(),
    }
}
