//! Fingers are found in the tree of any hand.

use robot::RobotModel;

const ALLEGRO: &str = include_str!("../../../../data/robots/allegro_right.urdf");

/// The robot's fingers in words: joints, tip, thumb or not.
fn found(model: &RobotModel) -> Vec<(String, String, bool)> {
    let words = |finger: robot::Finger| {
        let joints: Vec<&str> = finger
            .joints
            .iter()
            .map(|&joint| model.joints()[joint].name.as_str())
            .collect();
        let tip = model.links()[finger.tip_link].name.clone();
        assert_eq!(finger.links.last(), Some(&finger.tip_link));
        (joints.join(" "), tip, finger.is_thumb)
    };
    model.fingers().into_iter().map(words).collect()
}

fn check(model: &RobotModel, expected: &[(&str, &str, bool)]) {
    let found = found(model);
    let found: Vec<(&str, &str, bool)> = found
        .iter()
        .map(|(joints, tip, is_thumb)| (joints.as_str(), tip.as_str(), *is_thumb))
        .collect();
    assert_eq!(found, expected);
}

const ALLEGRO_FINGERS: [(&str, &str, bool); 4] = [
    (
        "joint_0.0 joint_1.0 joint_2.0 joint_3.0",
        "link_3.0_tip",
        false,
    ),
    (
        "joint_4.0 joint_5.0 joint_6.0 joint_7.0",
        "link_7.0_tip",
        false,
    ),
    (
        "joint_8.0 joint_9.0 joint_10.0 joint_11.0",
        "link_11.0_tip",
        false,
    ),
    (
        "joint_12.0 joint_13.0 joint_14.0 joint_15.0",
        "link_15.0_tip",
        true,
    ),
];

#[test]
fn allegro_has_three_fingers_and_a_thumb_without_names() {
    let model = RobotModel::from_urdf(ALLEGRO).unwrap();
    check(&model, &ALLEGRO_FINGERS);
    for finger in model.fingers() {
        assert_eq!(model.links()[finger.palm].name, "base_link");
        assert_eq!(finger.tip_offset_m.norm(), 0.0);
    }
    // From the origin of link_0.0: 16.4 + 54 + 38.4 + 26.7 mm.
    assert!((model.fingers()[0].length_m - 0.1355).abs() < 1e-9);
}

/// A joint about y, 4 cm above its parent's frame.
fn joint(name: &str, parent: &str, child: &str, origin: &str, more: &str) -> String {
    format!(
        r#"<joint name="{name}" type="revolute"><origin {origin}/><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/><limit lower="0" upper="1.5" effort="1" velocity="1"/>{more}</joint>"#
    )
}

#[test]
fn arm_wrist_and_mimic_joints_are_not_counted_as_fingers() {
    let up = r#"xyz="0 0 0.04""#;
    let mut xml = r#"<robot name="r"><link name="base"/><link name="arm"/><link name="palm"/><link name="flange"/><link name="camera"/>"#.to_owned();
    xml += &joint("elbow", "base", "arm", up, "");
    xml += &joint("wrist", "arm", "palm", up, "");
    xml += r#"<joint name="camera_mount" type="fixed"><parent link="flange"/><child link="camera"/></joint>"#;
    xml += r#"<joint name="flange_mount" type="fixed"><parent link="palm"/><child link="flange"/></joint>"#;
    for finger in ["thumb", "index"] {
        let box_ = r#"<collision><origin xyz="0 0 0.02"/><geometry><box size="0.01 0.01 0.04"/></geometry></collision>"#;
        xml += &format!(
            r#"<link name="{finger}_1"/><link name="{finger}_2">{box_}</link><link name="{finger}_frame"/>"#
        );
        xml += &joint(
            &format!("{finger}_mcp"),
            "palm",
            &format!("{finger}_1"),
            up,
            "",
        );
        let mimic = format!(r#"<mimic joint="{finger}_mcp" multiplier="1.1"/>"#);
        xml += &joint(
            &format!("{finger}_pip"),
            &format!("{finger}_1"),
            &format!("{finger}_2"),
            up,
            &mimic,
        );
        xml += &format!(
            r#"<joint name="{finger}_frame_joint" type="fixed"><parent link="{finger}_2"/><child link="{finger}_frame"/></joint>"#
        );
    }
    let model = RobotModel::from_urdf(&(xml + "</robot>")).unwrap();
    check(
        &model,
        &[
            ("thumb_mcp", "thumb_2", true),
            ("index_mcp", "index_2", false),
        ],
    );
    for finger in model.fingers() {
        assert_eq!(model.links()[finger.palm].name, "palm");
        // The far end of the box, beyond the joint.
        assert!((finger.tip_offset_m - nalgebra::Vector3::z() * 0.04).norm() < 1e-12);
        assert!((finger.length_m - 0.08).abs() < 1e-12);
    }
}

#[test]
fn one_chain_is_one_finger_and_fixed_links_have_none() {
    let xml = format!(
        r#"<robot name="r"><link name="a"/><link name="b"/><link name="c"/>{}{}</robot>"#,
        joint("j", "a", "b", "", ""),
        joint("k", "b", "c", r#"xyz="0 0 0.1""#, "")
    );
    check(
        &RobotModel::from_urdf(&xml).unwrap(),
        &[("j k", "c", false)],
    );
    let still = RobotModel::from_urdf(r#"<robot name="r"><link name="a"/></robot>"#).unwrap();
    assert_eq!(still.fingers(), []);
}
