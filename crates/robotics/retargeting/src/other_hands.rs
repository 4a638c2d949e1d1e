//! Hands that are not among the project's own: a URDF and a TOML table are all they need.

use nalgebra::{Isometry3, Vector3};
use posture::{Hand, HandTable, Posture};
use proptest::prelude::*;
use robot::RobotModel;

use crate::{Retargeted, fixture, retarget};

/// A hand in the manner of those with six motors: five fingers along −y that bend about −x, whose
/// distal joints follow the proximal ones, a thumb of two motors whose last two joints follow one
/// another, a root that is not the palm, links and joints in no order, meshes nobody has.
fn six_motors() -> RobotModel {
    let joint = |name: &str, parent: &str, child: &str, xyz: [f64; 3], axis: &str, more: &str| {
        let [x, y, z] = xyz;
        format!(
            r#"<joint name="{name}" type="revolute"><axis xyz="{axis}"/>{more}
               <parent link="{parent}"/><child link="{child}"/><origin xyz="{x} {y} {z}"/></joint>"#
        )
    };
    let limit =
        |upper: f64| format!(r#"<limit lower="0" upper="{upper}" effort="2" velocity="3"/>"#);
    let follows = |joint: &str, multiplier: f64, offset: f64| {
        format!(
            r#"{}<mimic joint="{joint}" multiplier="{multiplier}" offset="{offset}"/>"#,
            limit(3.0)
        )
    };
    let mut parts = vec![
        r#"<joint name="mount" type="fixed"><parent link="flange"/><child link="palm"/>
           <origin xyz="0 0 0.02" rpy="0 0 1.5707963"/></joint>"#
            .to_owned(),
    ];
    let mut links = vec!["flange".to_owned()];
    for (finger, x) in [
        ("index", -0.03),
        ("middle", -0.01),
        ("ring", 0.01),
        ("little", 0.03),
    ] {
        let [base, end, tip] = ["base", "end", "tip"].map(|part| format!("{finger}_{part}"));
        let motor = format!("{finger}_motor");
        parts.push(joint(
            &format!("{finger}_follows"),
            &base,
            &end,
            [0.0, -0.04, 0.0],
            "-1 0 0",
            &follows(&motor, 1.13, -0.02),
        ));
        parts.push(joint(
            &motor,
            "palm",
            &base,
            [x, -0.09, 0.0],
            "-1 0 0",
            &limit(1.4),
        ));
        parts.push(format!(
            r#"<joint name="{finger}_t" type="fixed"><parent link="{end}"/><child link="{tip}"/>
               <origin xyz="0 -0.045 0.004"/></joint>"#
        ));
        links.extend([base, end, tip]);
    }
    parts.push(joint(
        "thumb_3",
        "t2",
        "t3",
        [0.0, -0.03, 0.0],
        "-1 0 0",
        &follows("thumb_2", 0.8, 0.0),
    ));
    parts.push(joint(
        "thumb_1",
        "palm",
        "t1",
        [-0.03, -0.03, 0.01],
        "0 1 0",
        &limit(1.2),
    ));
    parts.push(joint(
        "thumb_4",
        "t3",
        "t4",
        [0.0, -0.02, 0.0],
        "-1 0 0",
        &follows("thumb_3", 0.9, 0.0),
    ));
    parts.push(joint(
        "thumb_2",
        "t1",
        "t2",
        [-0.01, -0.02, 0.0],
        "-0.7 0.1 0.3",
        &limit(0.6),
    ));
    parts.push(
        r#"<joint name="thumb_t" type="fixed"><parent link="t4"/><child link="thumb_tip"/>
           <origin xyz="0 -0.025 0"/></joint>"#
            .to_owned(),
    );
    links.extend(["t1", "t2", "t3", "t4", "thumb_tip", "palm"].map(str::to_owned));
    for link in links {
        let mesh = r#"<geometry><mesh filename="package://nowhere/hand.stl"/></geometry>"#;
        parts.push(format!(
            r#"<link name="{link}"><visual>{mesh}</visual><collision>{mesh}</collision></link>"#
        ));
    }
    let text = format!(r#"<robot name="six_motors">{}</robot>"#, parts.concat());
    RobotModel::from_urdf(&text).unwrap()
}

const TABLE: &str = r#"
    side = "right"
    scale = 1.0
    points = [
        { keypoint = "thumb_tip", link = "thumb_tip", weight = 1.0, tip_radius_m = 0.0 },
        { keypoint = "index_tip", link = "index_tip", weight = 1.0, tip_radius_m = 0.0 },
        { keypoint = "middle_tip", link = "middle_tip", weight = 1.0, tip_radius_m = 0.0 },
        { keypoint = "ring_tip", link = "ring_tip", weight = 1.0, tip_radius_m = 0.0 },
        { keypoint = "little_tip", link = "little_tip", weight = 1.0, tip_radius_m = 0.0 },
        { keypoint = "thumb_dip", link = "t4", weight = 0.3 },
        { keypoint = "index_dip", link = "index_end", weight = 0.3 },
        { keypoint = "little_dip", link = "little_end", weight = 0.3 },
        { keypoint = "wrist", link = "flange", weight = 0.3 },
    ]
"#;

/// Returns the hand, and what it makes of being shown its own points.
fn shown_itself(posture: &Posture) -> (Hand, Retargeted) {
    let table: HandTable = TABLE.parse().unwrap();
    let hand = Hand::new(six_motors(), &table).unwrap();
    let keypoints = fixture::own_points(&hand, posture);
    let steps = fixture::steps(vec![keypoints; 3]);
    let config = fixture::following_only();
    let retargeted = retarget(&hand, &fixture::environment(), &config, &steps);
    (hand, retargeted.unwrap().unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// A hand whose joints follow one another takes its own posture, within its limits.
    #[test]
    fn a_hand_with_few_motors_recovers_its_own_posture(
        shares in prop::collection::vec(0.1..0.9, 6),
        turn in prop::array::uniform3(-2.0..2.0),
    ) {
        let model = six_motors();
        prop_assert_eq!(model.dof(), 6);
        let q = model.joints().iter().zip(shares);
        let posture = Posture::new(
            &spatial::Pose::new(Isometry3::new(Vector3::new(-0.3, 0.1, 0.2), Vector3::from(turn))),
            q.map(|(joint, share)| joint.lower + share * (joint.upper - joint.lower)).collect(),
        );
        let (hand, tracked) = shown_itself(&posture);
        prop_assert!(tracked.grasp_keypoint_error_m < 1e-3, "{} m", tracked.grasp_keypoint_error_m);
        for step in tracked.motion.steps() {
            for (q, joint) in step.q_rad.iter().zip(hand.model.joints()) {
                prop_assert!((joint.lower..=joint.upper).contains(q));
            }
        }
    }
}
