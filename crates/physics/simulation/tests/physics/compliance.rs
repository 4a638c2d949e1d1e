//! A palm that yields: a plate on a slide pushes a block that is too heavy to move, with the force of its drive.

use motion::{Motion, Step};
use nalgebra::Isometry3;
use robot::RobotModel;
use simulation::{
    Approach, PalmComplianceConfig, Protocol, Rollout, SceneConfig, SettledScene, TraceMode,
    Verdict,
};
use spatial::Pose;

use crate::{bodies::body, scene};

/// A plate that slides along −y below a palm; at 0.035 m it touches the block.
const PLATE: &str = r#"<robot name="plate">
  <link name="palm"><inertial><mass value="0.5"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="plate"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0.005 0"/><geometry><box size="0.03 0.01 0.03"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="palm"/><child link="plate"/>
    <origin xyz="0 0.06 0"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.5" effort="50" velocity="1"/></joint>
</robot>"#;
/// The block: a box, with its half extents in meters and its mass in kilograms.
const BLOCK: (&str, u32, [f64; 3], f64) = ("block", 0, [0.025; 3], 300.0);

fn scene(force_n: f64, palm_compliance: Option<PalmComplianceConfig>) -> SceneConfig {
    let mut scene = SceneConfig {
        // The plate slides up the block without taking hold of it.
        friction: 0.1,
        palm_compliance,
        ..scene::scene()
    };
    (scene.drive.stiffness, scene.drive.damping) = (20_000.0, 200.0);
    scene.drive.torque_limit = force_n;
    scene
}

/// Carries the palm along y and the plate on its slide from one place to another.
fn rollout(scene: &SceneConfig, y_m: [f64; 2], slide_m: [f64; 2]) -> Rollout {
    let protocol = Protocol {
        approach: Approach::Follow,
        flexion_joints: Vec::new(),
        early_tolerance_m: 1.0,
        ..scene::protocol()
    };
    let (_, block, rest) = body(BLOCK);
    let plate = RobotModel::from_urdf(PLATE).unwrap();
    let step = |which: usize| Step {
        time_s: [0.0, 0.8][which],
        frame_from_palm: Pose::new(Isometry3::translation(0.0, y_m[which], 0.0)),
        q_rad: vec![slide_m[which]],
        rates: (),
    };
    let motion = Motion::new(&plate.joint_names(), vec![step(0), step(1)]).unwrap();
    let settled = SettledScene::new(scene, &plate, &block, &rest).unwrap();
    settled
        .rollout(&motion, &protocol, TraceMode::Trace)
        .unwrap()
}

/// Presses with the plate on the block.
fn pressing(force_n: f64, palm_compliance: Option<PalmComplianceConfig>) -> Rollout {
    let scene = scene(force_n, palm_compliance);
    rollout(&scene, [0.0, 0.0], [0.03, 0.06])
}

#[test]
fn a_force_below_the_limit_displaces_the_palm_by_force_over_stiffness() {
    let arm = PalmComplianceConfig::default();
    for force_n in [20.0, 45.0] {
        let rollout = pressing(force_n, Some(arm));
        assert_eq!(rollout.verdict, Verdict::NotGrasped);
        // The pause ends after 1.4 s; the block pushes the hand along y.
        let steps = rollout.trace.unwrap().steps;
        let expected_m = force_n / arm.stiffness_n_per_m;
        for step in &steps[60..70] {
            let palm = step.table_from_palm.translation.vector;
            assert!(
                (palm.y / expected_m - 1.0).abs() < 0.02,
                "{force_n} N: {palm}"
            );
            assert!(
                palm.x.abs() < 1e-4 && (palm.z - 0.025).abs() < 1e-4,
                "{palm}"
            );
        }
        // It deviates in the lift too, as long as the plate is on the block.
        let lifting = &steps[75].table_from_palm.translation.vector;
        assert!(
            (lifting.y / expected_m - 1.0).abs() < 0.1,
            "{force_n} N: {lifting}"
        );
    }
}

#[test]
fn a_force_above_the_limit_overloads_the_arm() {
    let arm = PalmComplianceConfig::default();
    let rollout = pressing(60.0, Some(arm));
    assert_eq!(rollout.verdict, Verdict::Overloaded);
    let steps = rollout.trace.unwrap().steps;
    let off_m = steps.last().unwrap().table_from_palm.translation.y;
    assert!(off_m > arm.max_deviation_m, "{off_m} m");
    let before = &steps[steps.len() - 2];
    assert!(before.table_from_palm.translation.y <= arm.max_deviation_m);
    assert_eq!(pressing(60.0, None).verdict, Verdict::NotGrasped);
}

#[test]
fn a_motion_through_a_block_overloads_the_arm() {
    let through = |palm_compliance| {
        let scene = scene(100.0, palm_compliance);
        rollout(&scene, [0.0, -0.1], [0.03, 0.03]).verdict
    };
    assert_eq!(
        through(Some(PalmComplianceConfig::default())),
        Verdict::Overloaded
    );
    assert_ne!(through(None), Verdict::Overloaded);
}

#[test]
fn an_arm_too_heavy_to_yield_moves_as_a_palm_without_one() {
    let heavy = PalmComplianceConfig {
        mass_kg: 1e6,
        inertia_kg_m2: 1e6,
        ..PalmComplianceConfig::default()
    };
    let traced = |palm_compliance| {
        let scene = SceneConfig {
            palm_compliance,
            ..scene::scene()
        };
        let flexed = scene::q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]);
        let motion = scene::side_grasp([-0.015, -0.055, 0.02], &flexed);
        let rollout = scene::settled(&scene).rollout(&motion, &scene::protocol(), TraceMode::Trace);
        let rollout = rollout.unwrap();
        assert_eq!(rollout.verdict, Verdict::Held);
        rollout.trace.unwrap().steps
    };
    let [exact, heavy] = [None, Some(heavy)].map(traced);
    assert_eq!(exact.len(), heavy.len());
    for (exact, heavy) in exact.iter().zip(&heavy) {
        let off = exact.table_from_palm.inv_mul(&heavy.table_from_palm);
        assert!(off.translation.vector.norm() < 1e-4, "{off:?}");
        assert!(off.rotation.angle() < 1e-3, "{off:?}");
    }
}
