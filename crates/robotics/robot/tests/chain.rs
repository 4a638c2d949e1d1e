//! Arms from their root to their end: derivatives, and joint positions for a pose.

use std::f64::consts::TAU;

use nalgebra::{Point3, UnitQuaternion, Vector3, Vector6};
use proptest::{prelude::*, strategy::ValueTree, test_runner::TestRunner};
use robot::{Chain, RobotError, RobotModel};
use spatial::{Base, Palm, Pose, Twist};

const XARM: &str = include_str!("../../../../data/robots/xarm6_allegro.urdf");
/// Turns and slides along axes that are those of no frame.
const ODD: &str = r#"<robot name="odd">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>
  <joint name="turn" type="continuous"><parent link="a"/><child link="b"/>
    <origin xyz="0.1 0 0.2" rpy="0.3 -0.2 1"/><axis xyz="1 2 3"/></joint>
  <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/>
    <origin xyz="0 0.3 0.1" rpy="1 0.4 0"/><axis xyz="-1 1 0.5"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="fixed" type="fixed"><parent link="c"/><child link="d"/>
    <origin xyz="0.2 0.1 0" rpy="0 1.1 0.3"/></joint>
  <joint name="bend" type="revolute"><parent link="d"/><child link="e"/>
    <origin xyz="0 0 0.4" rpy="0 0 1.5"/><axis xyz="0 -1 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"#;
/// Smallest singular value above which the xArm is not near a singularity.
const REGULAR: f64 = 0.02;

fn xarm() -> (RobotModel, Chain) {
    let robot = RobotModel::from_urdf(XARM).unwrap();
    let chain = Chain::to_link(&robot, "base_link").unwrap();
    (robot, chain)
}

/// Joint positions within the xArm's limits; the shares are from 0 to 1.
fn within_limits(robot: &RobotModel, chain: &Chain, shares: &[f64]) -> Vec<f64> {
    let joints = chain.joints().iter().map(|&joint| &robot.joints()[joint]);
    joints
        .zip(shares)
        .map(|(joint, share)| joint.lower + share * (joint.upper - joint.lower))
        .collect()
}

fn off(a: &Pose<Base, Palm>, b: &Pose<Base, Palm>) -> f64 {
    let distance = (a.translation.vector - b.translation.vector).norm();
    distance.max((a.rotation * b.rotation.inverse()).angle())
}

/// Returns the twist over a short time, by differences.
fn twist(before: &Pose<Base, Palm>, after: &Pose<Base, Palm>, time_s: f64) -> Twist<Base> {
    let moved = after.translation.vector - before.translation.vector;
    let turn = (after.rotation * before.rotation.inverse()).scaled_axis();
    Twist::new(moved / time_s, turn / time_s)
}

fn norm(twist: &Twist<Base>) -> f64 {
    Vector6::from(twist.to_array()).norm()
}

#[test]
fn chain_has_only_the_joints_on_its_path() {
    let (robot, chain) = xarm();
    let names: Vec<&str> = chain
        .joints()
        .iter()
        .map(|&joint| robot.joints()[joint].name.as_str())
        .collect();
    assert_eq!(
        names,
        ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]
    );
    assert_eq!(Chain::to_link(&robot, "link_base").unwrap().dof(), 0);
    assert!(matches!(
        Chain::to_link(&robot, "base_lnik"),
        Err(RobotError::MissingLink { .. })
    ));
    assert_eq!(chain.state(&[0.0; 5]).unwrap_err().expected, 6);
}

#[test]
fn a_joint_that_follows_another_is_refused() {
    let urdf = r#"<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="first" type="continuous"><parent link="a"/><child link="b"/></joint>
      <joint name="second" type="continuous"><parent link="b"/><child link="c"/>
        <mimic joint="first"/></joint></robot>"#;
    let robot = RobotModel::from_urdf(urdf).unwrap();
    assert_eq!(Chain::to_link(&robot, "b").unwrap().dof(), 1);
    let err = Chain::to_link(&robot, "c").unwrap_err();
    assert_eq!(
        err.to_string(),
        "joint `second` on the path from the root to link `c` follows another joint"
    );
}

#[test]
fn slides_and_turns_of_any_axis_have_their_derivatives() {
    let robot = RobotModel::from_urdf(ODD).unwrap();
    let chain = Chain::to_link(&robot, "e").unwrap();
    check_derivatives(&robot, &chain, "e", &[0.2, 0.5, -0.8], &[1.0, -0.6, 0.7]);
    let at = chain.state(&[0.2, 0.5, -0.8]).unwrap();
    assert_eq!(at.min_singular_value(), 0.0);
}

/// Checks that the end's pose is that of the whole robot, and that twist and bias equal finite
/// differences.
fn check_derivatives(robot: &RobotModel, chain: &Chain, end: &str, q: &[f64], velocity: &[f64]) {
    let mut all = vec![0.0; robot.dof()];
    for (&joint, &q) in chain.joints().iter().zip(q) {
        all[joint] = q;
    }
    let poses = robot.forward_kinematics::<Base>(&all).unwrap();
    let link = robot.link(end).unwrap();
    let now = chain.state(q).unwrap();
    assert!(off(&poses[link].reinterpret(), &now.base_from_palm) < 1e-12);
    let origin = Point3::from(poses[link].translation.vector);
    let jacobian = robot.geometric_jacobian(&poses, link, &origin);
    for (column, &joint) in now.jacobian.column_iter().zip(chain.joints()) {
        assert!((column - jacobian.column(joint)).norm() < 1e-12);
    }
    let h = 1e-6;
    let moved = |by: f64| {
        let q: Vec<f64> = q.iter().zip(velocity).map(|(q, v)| q + by * v).collect();
        chain.state(&q).unwrap()
    };
    let (before, after) = (moved(-h), moved(h));
    let slope = twist(&before.base_from_palm, &after.base_from_palm, 2.0 * h);
    assert!(norm(&(slope - now.twist(velocity))) < 1e-7);
    let bend = (after.twist(velocity) - before.twist(velocity)) * (0.5 / h);
    assert!(norm(&(bend - now.bias_acceleration(velocity))) < 1e-7);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn twist_and_bias_are_derivatives(
        shares in prop::collection::vec(0.0..1.0_f64, 6),
        velocity in prop::collection::vec(-2.0..2.0_f64, 6),
    ) {
        let (robot, chain) = xarm();
        let q = within_limits(&robot, &chain, &shares);
        check_derivatives(&robot, &chain, "base_link", &q, &velocity);
    }

    /// From a twist and its rate to the joints' rates and back.
    #[test]
    fn rates_make_the_twist(
        shares in prop::collection::vec(0.0..1.0_f64, 6),
        twist in prop::array::uniform6(-1.0..1.0_f64),
        rate in prop::array::uniform6(-5.0..5.0_f64),
    ) {
        let (robot, chain) = xarm();
        let at = chain.state(&within_limits(&robot, &chain, &shares)).unwrap();
        prop_assume!(at.min_singular_value() > 1e-3);
        let (twist, rate) = (Twist::from_array(twist), Twist::from_array(rate));
        let found = at.rates(&twist, &rate).unwrap();
        prop_assert!(norm(&(at.twist(&found.velocity) - twist)) < 1e-10);
        let made = at.twist(&found.acceleration) + at.bias_acceleration(&found.velocity);
        prop_assert!(norm(&(made - rate)) < 1e-9 * (1.0 + norm(&at.bias_acceleration(&found.velocity))));
        for least in [1e-3, 0.01, 0.03, 0.1, 0.3] {
            prop_assert_eq!(at.is_regular(least), at.min_singular_value() >= least);
        }
    }

    /// From near the joints that made a pose, the same joints are found again.
    #[test]
    fn the_joints_of_a_pose_are_found_from_near(
        shares in prop::collection::vec(0.02..0.98_f64, 6),
        away in prop::array::uniform6(-0.01..0.01_f64),
    ) {
        let (robot, chain) = xarm();
        let q = within_limits(&robot, &chain, &shares);
        let at = chain.state(&q).unwrap();
        prop_assume!(at.min_singular_value() > REGULAR);
        let near: Vec<f64> = q.iter().zip(away).map(|(q, away)| q + away).collect();
        let found = chain.inverse_kinematics(&at.base_from_palm, &near).unwrap();
        let there = chain.state(&found).unwrap().base_from_palm;
        prop_assert!(off(&there, &at.base_from_palm) < 1e-10);
        for (found, q) in found.iter().zip(&q) {
            prop_assert!((found - q).abs() < 1e-8, "{found} {q}");
        }
    }
}

/// Every solution is one, no two are the same, and that which made the pose is among them, next to
/// always, whatever turns its joints have made.
#[test]
fn all_solutions_of_a_pose_are_found() {
    let (robot, chain) = xarm();
    let mut runner = TestRunner::deterministic();
    let (mut poses, mut missed) = (0, 0);
    while poses < 300 {
        let shares = prop::collection::vec(0.02..0.98_f64, 6);
        let shares = shares.new_tree(&mut runner).unwrap().current();
        let q = within_limits(&robot, &chain, &shares);
        let at = chain.state(&q).unwrap();
        if at.min_singular_value() <= REGULAR {
            continue;
        }
        poses += 1;
        let solutions = chain.ik_solutions(&at.base_from_palm);
        for (idx, solution) in solutions.iter().enumerate() {
            let there = chain.state(solution).unwrap().base_from_palm;
            assert!(off(&there, &at.base_from_palm) < 1e-10);
            let is_same = |other: &Vec<f64>| is_turned(solution, other);
            assert!(!solutions[..idx].iter().any(is_same));
        }
        missed += i32::from(!solutions.iter().any(|solution| is_turned(solution, &q)));
        assert_eq!(solutions, chain.ik_solutions(&at.base_from_palm));
    }
    assert!(missed <= 2, "{missed} of {poses}");
}

/// Whether two solutions differ by whole turns at most.
fn is_turned(a: &[f64], b: &[f64]) -> bool {
    let turns = a.iter().zip(b).map(|(a, b)| (a - b) / TAU);
    turns
        .map(|turns| (turns - turns.round()).abs())
        .fold(0.0, f64::max)
        < 1e-6
}

#[test]
fn a_pose_out_of_reach_has_no_solution() {
    let (_, chain) = xarm();
    let at = |x: f64| {
        Pose::from_parts(
            Vector3::new(x, 0.0, 0.3),
            UnitQuaternion::from_scaled_axis(Vector3::y() * std::f64::consts::PI),
        )
    };
    assert!(!chain.ik_solutions(&at(0.4)).is_empty());
    assert!(chain.ik_solutions(&at(1.2)).is_empty());
    assert_eq!(chain.inverse_kinematics(&at(1.2), &[0.0; 6]), None);
}

#[test]
fn a_stretched_elbow_is_singular() {
    let (_, chain) = xarm();
    // Where wrist, elbow and shoulder are in one line.
    let bent = |q3: f64| chain.state(&[0.1, 0.2, q3, 0.3, 0.8, 0.0]).unwrap();
    let stretched = -(0.2845_f64 / 0.0535).atan() + (0.0775_f64 / 0.3425).atan();
    let least = |q3: f64| bent(q3).min_singular_value();
    let worst = (-400..400)
        .map(|k| least(stretched + f64::from(k) * 0.01))
        .fold(f64::INFINITY, f64::min);
    assert!(worst < 2e-3, "{worst}");
    assert!(least(-1.6) > 0.05, "{}", least(-1.6));
}
