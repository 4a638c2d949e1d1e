//! A finger that slides, beside a cube.

use motion::{HandRates, Motion, Step};
use nalgebra::{Isometry3, Matrix3, Point3};
use robot::RobotModel;
use simulation::{ObjectShape, Protocol, SceneConfig};
use spatial::{Object, Pose};

use crate::{PlacedMotion, PoseError, ScreeningOptions};

/// A finger that slides, as a ball.
const HAND: &str = r#"<robot name="h"><link name="palm"/>
  <link name="tip"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="j" type="prismatic"><parent link="palm"/><child link="tip"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;

pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(HAND).unwrap()
}

pub(crate) fn scene() -> SceneConfig {
    let drive = serde_json::json!({
        "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
    });
    serde_json::from_value(serde_json::json!({ "drive": drive })).unwrap()
}

pub(crate) fn protocol() -> Protocol {
    serde_json::from_value(serde_json::json!({"flexion_joints": ["j"]})).unwrap()
}

pub(crate) fn options<'a>(scene: &'a SceneConfig, protocol: &'a Protocol) -> ScreeningOptions<'a> {
    ScreeningOptions {
        scene,
        protocol,
        max_penetration_m: 0.005,
        max_finger_penetration_m: 0.002,
        pose_noise: 0.0,
        pose_error: PoseError::default(),
        seed: 7,
    }
}

/// A cube of 4 cm and 0.1 kg, and its corners.
pub(crate) fn cube() -> (ObjectShape, Vec<[f64; 3]>) {
    let ends = [-0.02, 0.02];
    let corners_m: Vec<[f64; 3]> = ends
        .into_iter()
        .flat_map(|x| ends.into_iter().flat_map(move |y| ends.map(|z| [x, y, z])))
        .collect();
    let shape = ObjectShape {
        parts_m: vec![
            corners_m
                .iter()
                .map(|&corner| Point3::from(corner))
                .collect(),
        ],
        surface: None,
        mass_kg: 0.1,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::from_diagonal_element(3e-5),
    };
    (shape, corners_m)
}

/// The hand, with a joint of this name, waiting beside the cube.
pub(crate) fn waiting(joint: &str) -> Motion<Object> {
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::translation(0.3, 0.0, 0.1)),
        q_rad: vec![0.0],
        rates: HandRates::zero(1),
    };
    Motion::new(&[joint], vec![step(0.0), step(1.0)]).unwrap()
}

/// The same with the cube on the table.
pub(crate) fn placed(motion: &Motion<Object>) -> PlacedMotion<'_> {
    PlacedMotion {
        table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 0.02)),
        motion,
    }
}
