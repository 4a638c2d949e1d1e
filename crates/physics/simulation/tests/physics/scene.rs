//! A can, the Allegro hand and settings that hold.

use std::f64::consts::TAU;

use motion::{Motion, Step};
use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use robot::RobotModel;
use simulation::{
    Approach, ControllerKind, DriveConfig, ObjectShape, Offset, Protocol, ProtocolName, PullConfig,
    SceneConfig, SettledScene, Shortcuts, StrictConfig, Support, Trial,
};
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
    SceneConfig {
        friction: 1.0,
        table_friction: None,
        object_mass_kg: None,
        object_density_kg_per_m3: None,
        support: Support::Table,
        mass_scale: 1.0,
        hand_mass_scale: 1.0,
        object_offset: Offset::default(),
        time_step_s: 0.004,
        substeps: 1,
        steps_per_control: 5,
        prediction_m: 0.002,
        contact_recycle_m: 0.0,
        fingers_touch: false,
        fingers_touch_palm: false,
        settle_s: 1.0,
        drive: DriveConfig {
            controller: ControllerKind::Pd,
            stiffness: 20.0,
            damping: 1.0,
            torque_limit: 0.7,
            armature: 0.001,
            stop_stiffness: 200.0,
            delay_s: 0.0,
        },
        palm_drive: None,
        palm_compliance: None,
        shortcuts: Shortcuts {
            refused: true,
            ..Shortcuts::NONE
        },
    }
}

pub(crate) fn protocol() -> Protocol {
    let flexion = [1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15];
    Protocol {
        approach: Approach::Open,
        reach_s: 0.8,
        close_fraction: 0.25,
        flexion_joints: flexion.map(|joint| format!("joint_{joint}.0")).to_vec(),
        open_rad: 0.3,
        squeeze_rad: 0.15,
        squeeze_s: 0.3,
        pause_s: 0.3,
        lift_m: 0.15,
        lift_s: 0.4,
        hold_s: 2.0,
        lifted_m: 0.08,
        min_links: 2,
        max_slip_m_per_s: 0.01,
        knocked_m: 0.03,
        knocked_rad: 0.6,
        limit_tolerance_rad: 0.1,
        table_tolerance_m: 0.01,
        early_tolerance_m: 0.02,
        trial: Trial::Lift,
        strict: StrictConfig::default(),
        pull: PullConfig::default(),
        name: ProtocolName::TableLift,
        published: None,
    }
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
