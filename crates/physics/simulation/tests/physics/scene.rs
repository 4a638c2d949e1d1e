//! A can, the Allegro hand and settings that hold.

use std::f64::consts::TAU;

use motion::{Motion, Step};
use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use robot::RobotModel;
use simulation::{ObjectShape, Protocol, SceneConfig, SettledScene};
use spatial::{Object, Pose, RestingPose};

pub(crate) const RADIUS_M: f64 = 0.034;
pub(crate) const HEIGHT_M: f64 = 0.102;

pub(crate) fn urdf() -> String {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../data/robots/allegro_right.urdf"
    );
    std::fs::read_to_string(path).unwrap()
}

pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(&urdf()).unwrap()
}

pub(crate) fn scene() -> SceneConfig {
    let drive = serde_json::json!({
        "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
    });
    let shortcuts = serde_json::json!({"refused": true, "lost": false, "settled": false});
    let scene = serde_json::json!({"drive": drive, "shortcuts": shortcuts});
    serde_json::from_value(scene).unwrap()
}

pub(crate) fn protocol() -> Protocol {
    let flexion = [1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15];
    let protocol = serde_json::json!({
        "approach": "open",
        "flexion_joints": flexion.map(|joint| format!("joint_{joint}.0")),
    });
    serde_json::from_value(protocol).unwrap()
}

/// An upright can of 0.35 kg about its own center.
pub(crate) fn can() -> ObjectShape {
    let mass_kg = 0.35;
    let rim = (0..16).map(|idx| TAU * f64::from(idx) / 16.0);
    let points = rim
        .flat_map(|angle| {
            let (sin, cos) = angle.sin_cos();
            [-0.5, 0.5].map(|end| Point3::new(RADIUS_M * cos, RADIUS_M * sin, end * HEIGHT_M))
        })
        .collect();
    let across = mass_kg * (3.0 * RADIUS_M.powi(2) + HEIGHT_M.powi(2)) / 12.0;
    let along = mass_kg * RADIUS_M.powi(2) / 2.0;
    ObjectShape {
        surface: None,
        parts_m: vec![points],
        mass_kg,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::from_diagonal(&Vector3::new(across, across, along)),
    }
}

pub(crate) fn upright() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: HEIGHT_M / 2.0,
    }
}

pub(crate) fn settled(scene: &SceneConfig) -> SettledScene {
    SettledScene::new(scene, &hand(), &can(), &upright()).unwrap()
}

/// Joint positions by name, the others at 0.
pub(crate) fn q(flexion: [f64; 3], thumb: [f64; 4]) -> Vec<f64> {
    let model = hand();
    let mut q = vec![0.0; model.dof()];
    let mut set = |joint: usize, value: f64| {
        q[model.joint(&format!("joint_{joint}.0")).unwrap()] = value;
    };
    for finger in 0..3 {
        for (joint, value) in flexion.iter().enumerate() {
            set(4 * finger + joint + 1, *value);
        }
    }
    for (joint, value) in thumb.iter().enumerate() {
        set(12 + joint, *value);
    }
    q
}

/// The palm stands beside the can at `x`, `y` from its axis, fingers along the table's x,
/// thumb up, and comes along y from 15 cm away.
pub(crate) fn side_grasp(at: [f64; 3], q: &[f64]) -> Motion<Object, ()> {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, 0.5, 0.5, 0.5));
    let palm = |y: f64| Isometry3::from_parts(Translation3::new(at[0], at[1] + y, at[2]), turn);
    let steps = 8;
    let step = |step: i32| Step {
        time_s: 0.1 * f64::from(step),
        frame_from_palm: Pose::new(palm(-0.15 * (1.0 - f64::from(step) / f64::from(steps)))),
        q_rad: q.to_vec(),
        rates: (),
    };
    Motion::new(&hand().joint_names(), (0..=steps).map(step).collect()).unwrap()
}
