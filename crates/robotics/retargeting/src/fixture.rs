//! Test fixtures: the Allegro hand, its points and a box on a table.

use std::{fs, path::Path, sync::OnceLock};

use geometry::TriMesh;
use nalgebra::{Point3, Vector3};
use posture::{Environment, Hand, HandTable, KEYPOINTS, NoTerms, Posture, Solver, Task};
use robot::RobotModel;
use spatial::RestingPose;

use crate::{LandmarkStep, RetargetingConfig, Survey, settled, survey};

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

/// Returns options with every term on.
pub(crate) fn config() -> RetargetingConfig {
    RetargetingConfig {
        contact_position_factor: 0.3,
        max_iterations: 40,
        ..RetargetingConfig::default()
    }
}

/// Returns options with nothing but the paper's first term.
pub(crate) fn following_only() -> RetargetingConfig {
    RetargetingConfig {
        smoothness_weight: 0.0,
        joint_smoothness_weight: 0.0,
        object_weight: 0.0,
        table_weight: 0.0,
        contact_weight: 0.0,
        ..config()
    }
}

/// Returns the Allegro hand, at the person's size.
pub(crate) fn hand() -> Hand {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data");
    let urdf = fs::read_to_string(data.join("robots/allegro_right.urdf")).unwrap();
    let table = hand_files::load_table(&data.join("hands/allegro_right.toml")).unwrap();
    let table = HandTable {
        scale: 1.0,
        ..table
    };
    Hand::new(RobotModel::from_urdf(&urdf).unwrap(), &table).unwrap()
}

/// Returns a box about the origin.
pub(crate) fn mesh() -> TriMesh {
    let high = Point3::from(BOX_HALF_M);
    TriMesh::cuboid(-high, high)
}

/// Returns the box on its table.
pub(crate) fn environment() -> Environment {
    static SURVEY: OnceLock<Survey> = OnceLock::new();
    let survey = SURVEY.get_or_init(|| survey(&mesh(), 0.0025).unwrap().unwrap());
    let recorded = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: BOX_HALF_M[2],
    };
    let rest = settled(
        &survey.hull_in_object,
        &survey.center_of_mass_in_object,
        &recorded,
    );
    Environment::new(survey.field.clone(), rest)
}

/// Returns what a person's landmarks would be if the person had the robot's hand at a posture.
pub(crate) fn own_points(hand: &Hand, posture: &Posture) -> [[f64; 3]; KEYPOINTS] {
    let mut solver = Solver::new(&hand.compiled);
    let nothing = Task {
        targets: &[],
        loss: posture::Loss::Squared,
        vectors: None,
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

/// Returns steps with these landmarks, 30 per second.
pub(crate) fn steps(keypoints: Vec<[[f64; 3]; KEYPOINTS]>) -> Vec<LandmarkStep> {
    let steps = keypoints.into_iter().zip(0..);
    let step = |(keypoints_m, number)| LandmarkStep {
        time_s: f64::from(number) / 30.0,
        keypoints_m,
    };
    steps.map(step).collect()
}
