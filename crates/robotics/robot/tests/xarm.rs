//! The arm with the hand against the vendor's Denavit–Hartenberg table, and against the hand alone.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use robot::{DynamicsModel, FreeRootState, JointMotion, RobotModel};
use spatial::{Base, Palm, Pose};

const URDF: &str = include_str!("../../../../data/robots/xarm6_allegro.urdf");
const HAND: &str = include_str!("../../../../data/robots/allegro_right.urdf");

fn arm() -> RobotModel {
    RobotModel::from_urdf(URDF).unwrap()
}

/// Returns the pose of the flange in the arm's base by the vendor's table of standard parameters
/// (UFACTORY, *Kinematic and dynamic parameters*, xArm 6: d, α, a in millimeters, and the offset of
/// the angle), in the convention of Denavit and Hartenberg, 1955. The upper arm's length is there as
/// √(284.5² + 53.5²), which is 289.48661 and not, as is also written there, 289.48866.
fn flange_by_table(q: &[f64]) -> Isometry3<f64> {
    const TABLE: [[f64; 4]; 6] = [
        [267.0, -FRAC_PI_2, 0.0, 0.0],
        [0.0, 0.0, 289.486_61, -1.384_917_9],
        [0.0, -FRAC_PI_2, 77.5, 1.384_917_9],
        [342.5, FRAC_PI_2, 0.0, 0.0],
        [0.0, -FRAC_PI_2, 76.0, 0.0],
        [97.0, 0.0, 0.0, 0.0],
    ];
    let mut base_from_frame = Isometry3::identity();
    for ([d, alpha, a, offset], q) in TABLE.iter().zip(q) {
        base_from_frame *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q + offset);
        base_from_frame *= Translation3::new(a / 1000.0, 0.0, d / 1000.0);
        base_from_frame *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), *alpha);
    }
    base_from_frame
}

proptest! {
    /// To the digits that the table has.
    #[test]
    fn flange_is_where_the_vendors_table_has_it(q in prop::collection::vec(-3.0..3.0, 6)) {
        let arm = arm();
        let all: Vec<f64> = q.iter().copied().chain([0.5; 16]).collect();
        let poses = arm.forward_kinematics::<Base>(&all).unwrap();
        let difference = *poses[arm.link("link6").unwrap()].inverse() * flange_by_table(&q);
        prop_assert!(difference.translation.vector.norm() < 1e-7, "{difference}");
        prop_assert!(difference.rotation.angle() < 1e-7, "{difference}");
    }
}

#[test]
fn hand_is_the_same_as_alone_with_its_wrist_on_the_flange() {
    let (arm, hand) = (arm(), RobotModel::from_urdf(HAND).unwrap());
    assert_eq!((arm.dof(), hand.dof()), (22, 16));
    let q: Vec<f64> = (0..22).map(|idx| 0.3 + 0.02 * f64::from(idx)).collect();
    let base_from_links = arm.forward_kinematics::<Base>(&q).unwrap();
    let palm_from_links = hand.forward_kinematics(&q[6..]).unwrap();
    let first = arm.link("base_link").unwrap();
    let base_from_palm = Pose::<Base, Palm>::new(*base_from_links[first]);
    for (idx, link) in hand.links().iter().enumerate() {
        let ours = &arm.links()[first + idx];
        assert_eq!((&ours.name, &ours.inertial), (&link.name, &link.inertial));
        let expected = base_from_palm * palm_from_links[idx];
        let difference = base_from_links[first + idx].inverse() * expected;
        assert!(
            difference.translation.vector.norm() < 1e-12,
            "{}",
            link.name
        );
    }
    for (ours, joint) in arm.joints()[6..].iter().zip(hand.joints()) {
        assert_eq!(
            (&ours.name, ours.lower, ours.upper),
            (&joint.name, joint.lower, joint.upper)
        );
    }
    let flange_from_palm = base_from_links[arm.link("link6").unwrap()].inverse() * base_from_palm;
    let wrist = flange_from_palm * nalgebra::Point3::new(0.0, 0.0, -0.095);
    assert!(wrist.coords.norm() < 1e-12);
}

#[test]
fn arm_weighs_what_its_links_do_and_its_motors_can_hold_it() {
    let arm = arm();
    let bodies = DynamicsModel::new(&arm);
    // 10.4536 kg of the arm's links and 0.974 kg of hand.
    assert!(
        (bodies.mass_kg() - 11.4278).abs() < 0.001,
        "{}",
        bodies.mass_kg()
    );
    // Stretched out level: the upper arm's zero points up and back.
    let mut q = vec![0.0; 22];
    (q[1], q[2]) = (1.57, -0.19);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let still = JointMotion {
        q: &q,
        velocity: &[0.0; 22],
        acceleration: &[0.0; 22],
    };
    let held = bodies
        .inverse_dynamics(&FreeRootState::still(Pose::identity()), &still, &gravity)
        .unwrap();
    for (joint, effort) in arm.joints().iter().zip(&held.joints) {
        assert!(effort.abs() < joint.effort, "{}: {effort} Nm", joint.name);
    }
    assert!((held.root[2] - 9.81 * bodies.mass_kg()).abs() < 1e-9);
}
