//! The Allegro hand's description against figures measured on the vendor's own, and against itself.

use nalgebra::Point3;
use proptest::prelude::*;
use robot::{RobotModel, Shape};
use spatial::Palm;

const URDF: &str = include_str!("../../../../data/robots/allegro_right.urdf");
const LEFT: &str = include_str!("../../../../data/robots/allegro_left.urdf");
const TIPS: [&str; 4] = [
    "link_3.0_tip",
    "link_7.0_tip",
    "link_11.0_tip",
    "link_15.0_tip",
];

fn hand() -> RobotModel {
    RobotModel::from_urdf(URDF).unwrap()
}

/// Compares the tip centers, index to thumb, with millimeters that were rounded to 0.1.
fn check_tips(q: &[f64], expected_mm: [[f64; 3]; 4]) {
    // The left hand is the mirror image.
    for (urdf, side) in [(URDF, 1.0), (LEFT, -1.0)] {
        let hand = RobotModel::from_urdf(urdf).unwrap();
        let palm_from_links = hand.forward_kinematics::<Palm>(q).unwrap();
        for (tip, expected) in TIPS.iter().zip(expected_mm) {
            let found = palm_from_links[hand.link(tip).unwrap()].translation.vector * 1000.0;
            let expected = [expected[0], side * expected[1], expected[2]];
            for (found, expected) in found.iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 0.1,
                    "{} {tip}: {found:.2} mm, expected {expected} mm",
                    hand.name()
                );
            }
        }
    }
}

#[test]
fn tips_are_where_they_were_measured() {
    check_tips(
        &[0.0; 16],
        [
            [0.0, 55.3, 133.4],
            [0.0, 0.0, 136.2],
            [0.0, -55.3, 133.4],
            [-13.2, 167.7, -86.1],
        ],
    );
    check_tips(
        &hand().mid_range(),
        [
            [95.3, 47.5, 44.4],
            [95.3, 0.0, 46.8],
            [95.3, -47.5, 44.4],
            [84.0, 57.1, -10.2],
        ],
    );
}

#[test]
fn joints_have_the_hardware_limits() {
    let hand = hand();
    assert_eq!(hand.dof(), 16);
    for (idx, joint) in hand.joints().iter().enumerate() {
        assert_eq!(joint.name, format!("joint_{idx}.0"));
        assert_eq!((joint.effort, joint.velocity), (0.7, 7.0));
        assert_eq!(hand.links()[joint.link].joint, Some(idx));
    }
    assert_eq!(
        (hand.joints()[12].lower, hand.joints()[12].upper),
        (0.263, 1.396)
    );
}

#[test]
fn every_link_has_mass_and_shape() {
    let hand = hand();
    let mut total_kg = 0.0;
    for link in hand.links() {
        let inertial = link.inertial.as_ref().unwrap();
        total_kg += inertial.mass_kg;
        assert!(
            inertial.inertia_kg_m2.symmetric_eigenvalues().min() > 0.0,
            "{}",
            link.name
        );
        assert_eq!(link.collisions.len(), 1, "{}", link.name);
        let is_tip = link.name.ends_with("_tip");
        let is_ball = matches!(link.collisions[0].shape, Shape::Sphere { radius_m: 0.012 });
        assert_eq!(is_tip, is_ball, "{}", link.name);
    }
    assert_eq!(hand.links().len(), 21);
    assert!((total_kg - 0.974).abs() < 0.001, "{total_kg} kg");
}

/// Every link of the left hand is where the right one's is in a mirror, in any pose: the mirror
/// turns the fingers' spread about.
#[test]
fn left_hand_is_the_mirror_image() {
    let (right, left) = (hand(), RobotModel::from_urdf(LEFT).unwrap());
    assert_eq!(right.joint_names(), left.joint_names());
    let q: Vec<f64> = (0..16).map(|idx| 0.1 + 0.05 * f64::from(idx)).collect();
    let mut mirrored = q.clone();
    for spread in [0, 4, 8] {
        mirrored[spread] = -q[spread];
    }
    let palm_from_right = right.forward_kinematics::<Palm>(&q).unwrap();
    let palm_from_left = left.forward_kinematics::<Palm>(&mirrored).unwrap();
    for (idx, link) in right.links().iter().enumerate() {
        let center = link.inertial.as_ref().unwrap().center_of_mass_m;
        let expected = palm_from_right[idx] * center;
        let center = left.links()[idx]
            .inertial
            .as_ref()
            .unwrap()
            .center_of_mass_m;
        let found = palm_from_left[idx] * center;
        let difference = found - Point3::new(expected.x, -expected.y, expected.z);
        assert!(difference.norm() < 1e-6, "{}: {difference}", link.name);
    }
}

#[test]
fn missing_names_are_answered_with_near_ones() {
    let err = hand()
        .require_joints(&["joint_0.0", "joint_15"])
        .unwrap_err();
    assert_eq!(
        err.to_string(),
        "robot `allegro_right` has no joint `joint_15`"
    );
    assert!(
        err.hint().unwrap().contains("`joint_15.0`"),
        "{:?}",
        err.hint()
    );
    let err = hand().require_link("link_15_tip").unwrap_err();
    assert!(
        err.hint()
            .unwrap()
            .starts_with("did you mean `link_15.0_tip`"),
        "{:?}",
        err.hint()
    );
    let found = hand().require_joints(&["joint_3.0", "joint_0.0"]).unwrap();
    assert_eq!(found, [3, 0]);
}

#[test]
fn rejects_wrong_dof() {
    let err = hand().forward_kinematics::<Palm>(&[0.0; 15]).unwrap_err();
    assert_eq!(err.to_string(), "15 joint positions, expected 16");
}

proptest! {
    /// Analytic against central differences, to a micrometer per radian.
    #[test]
    fn jacobian_is_the_derivative(
        q in prop::collection::vec(-0.2..1.6, 16),
        link in 0_usize..21,
        point in prop::array::uniform3(-0.05..0.05),
    ) {
        const STEP: f64 = 1e-6;
        let hand = hand();
        let point_in_link = Point3::from(point);
        let at = |q: &[f64]| hand.forward_kinematics::<Palm>(q).unwrap()[link] * point_in_link;
        let palm_from_links = hand.forward_kinematics::<Palm>(&q).unwrap();
        let jacobian = hand.geometric_jacobian(&palm_from_links, link, &at(&q));
        for joint in 0..16 {
            let (mut more, mut less) = (q.clone(), q.clone());
            more[joint] += STEP;
            less[joint] -= STEP;
            let numeric = (at(&more) - at(&less)) / (2.0 * STEP);
            prop_assert!((numeric - jacobian.column(joint).fixed_rows::<3>(0)).norm() < 1e-6);
        }
    }
}
