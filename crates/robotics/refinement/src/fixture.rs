//! Test fixtures: the Allegro hand and a box on a table.

use std::{
    fs,
    path::Path,
    sync::{Arc, OnceLock},
};

use geometry::{DistanceField, TriMesh};
use motion::{Motion, Step};
use nalgebra::{Isometry3, Point3, Vector3};
use posture::{Environment, Hand};
use robot::RobotModel;
use spatial::{Object, Pose, RestingPose};

use crate::Payload;

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.03, 0.04, 0.05];

/// Returns the Allegro hand.
pub(crate) fn hand() -> Hand {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data");
    let urdf = fs::read_to_string(data.join("robots/allegro_right.urdf")).unwrap();
    let table = hand_files::load_table(&data.join("hands/allegro_right.toml")).unwrap();
    Hand::new(RobotModel::from_urdf(&urdf).unwrap(), &table).unwrap()
}

/// Returns the distances of the box.
pub(crate) fn field() -> Arc<DistanceField> {
    static FIELD: OnceLock<Arc<DistanceField>> = OnceLock::new();
    let field = FIELD.get_or_init(|| {
        let high = Point3::from(BOX_HALF_M);
        let mesh = TriMesh::cuboid(-high, high);
        Arc::new(DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap())
    });
    Arc::clone(field)
}

/// Returns the box's center of mass and its mass.
pub(crate) fn payload() -> Payload {
    Payload {
        center_of_mass_in_object: Point3::origin(),
        mass_kg: 0.3,
    }
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
    Environment::new(field(), rest())
}

/// The palm moves along x to the side of the box at this depth, and the fingers bend to a share of their ranges.
pub(crate) fn reach(hand: &Hand, into_m: f64, bend: f64) -> Motion<Object> {
    const STEPS: i32 = 20;
    let steps = (0..=STEPS).map(|step| {
        let share = f64::from(step) / f64::from(STEPS);
        let x = -0.25 * (1.0 - share) - BOX_HALF_M[0] - 0.02 + share * into_m;
        let turn = Vector3::new(0.1, 0.2, 0.0);
        let bend = share * bend;
        let joints = hand.model.joints().iter();
        Step {
            time_s: share,
            frame_from_palm: Pose::new(Isometry3::new(Vector3::new(x, 0.0, 0.05), turn)),
            q_rad: joints
                .map(|joint| joint.lower + bend * (joint.upper - joint.lower))
                .collect(),
            rates: (),
        }
    });
    let motion = Motion::new(&hand.model.joint_names(), steps.collect()).unwrap();
    motion.differentiated().unwrap()
}
