//! What no real robot is like is found, with its numbers; what is sound is left alone.

use robot::{RobotModel, Severity};

/// A robot whose link `a` turns on `palm` and has these elements; its joint has these limits.
fn robot(link: &str, limit: &str) -> RobotModel {
    let xml = format!(
        r#"<robot name="r"><link name="palm">{BOX}</link><link name="a">{link}</link><joint name="j" type="revolute"><origin xyz="0 0 0.1"/><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/><limit {limit}/></joint></robot>"#
    );
    RobotModel::from_urdf(&xml).unwrap()
}

const LIMIT: &str = r#"lower="-1" upper="1" effort="1" velocity="1""#;
/// Two centimeters wide and long, four high, above the origin.
const BOX: &str = r#"<collision><origin xyz="0 0 0.02"/><geometry><box size="0.02 0.02 0.04"/></geometry></collision>"#;

/// An inertial of 0.1 kg at this height with these moments and products of inertia.
fn inertial(height: f64, [ixx, iyy, izz, ixy, ixz, iyz]: [f64; 6]) -> String {
    format!(
        r#"<inertial><origin xyz="0 0 {height}"/><mass value="0.1"/><inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial>{BOX}"#
    )
}

/// That of a solid box.
const SOUND: [f64; 6] = [1.67e-5, 1.67e-5, 6.7e-6, 0.0, 0.0, 0.0];

/// Checks that the robot has exactly these findings: part and problem in words.
fn check(model: &RobotModel, expected: &[(Severity, &str)]) {
    let found: Vec<(Severity, String)> = model
        .examine()
        .iter()
        .map(|finding| {
            let words = format!("{} {}", finding.part, finding.problem);
            (finding.severity, words)
        })
        .collect();
    let found: Vec<(Severity, &str)> = found
        .iter()
        .map(|(severity, words)| (*severity, words.as_str()))
        .collect();
    assert_eq!(found, expected);
}

#[test]
fn a_sound_robot_has_no_findings() {
    check(&robot(&inertial(0.02, SOUND), LIMIT), &[]);
    for urdf in ["allegro_right", "allegro_left", "xarm6_allegro"] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/robots");
        let xml = std::fs::read_to_string(folder.join(format!("{urdf}.urdf"))).unwrap();
        check(
            &RobotModel::from_urdf(&xml).unwrap(),
            &[(
                Severity::Note,
                "joint `joint_12.0` cannot be at 0: its limits are 0.263 and 1.396",
            )],
        );
    }
}

#[test]
fn inertias_that_no_body_has_are_wrong() {
    use Severity::{Doubtful, Wrong};
    for (moments, severity, problem) in [
        ([0.0; 6], Wrong, "weighs 0.1 kg and has no inertia"),
        (
            [1e-5, 1e-5, -1e-6, 0.0, 0.0, 0.0],
            Wrong,
            "has an inertia that is not positive: principal moments -1.000e-6, 1.000e-5, 1.000e-5 kg m²",
        ),
        // Products of inertia that are larger than physical.
        (
            [1e-5, 1e-5, 1e-5, 2e-5, 0.0, 0.0],
            Wrong,
            "has an inertia that is not positive: principal moments -1.000e-5, 1.000e-5, 3.000e-5 kg m²",
        ),
        (
            [1e-5, 1e-5, 3e-5, 0.0, 0.0, 0.0],
            Wrong,
            "has an inertia that no body has: principal moments 1.000e-5, 1.000e-5, 3.000e-5 kg m², \
             the largest is more than the other two together",
        ),
        (
            [1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0],
            Doubtful,
            "has an inertia as if its mass were 100.0 mm from its center, and its shapes end at 24.5 mm",
        ),
    ] {
        let model = robot(&inertial(0.02, moments), LIMIT);
        let words = format!("link `a` {problem}");
        check(&model, &[(severity, words.as_str())]);
    }
}

#[test]
fn masses_in_odd_places_are_doubtful() {
    check(
        &robot(&inertial(0.06, SOUND), LIMIT),
        &[(
            Severity::Doubtful,
            "link `a` has its center of mass 20.0 mm outside the box about its shapes",
        )],
    );
    check(
        &robot("", LIMIT),
        &[(
            Severity::Doubtful,
            "robot weighs nothing: no link has a mass",
        )],
    );
    let without_mass = r#"<inertial><mass value="0"/></inertial>"#;
    let model = robot(without_mass, LIMIT);
    assert!(
        model.examine()[0]
            .problem
            .starts_with("has an `<inertial>` without mass")
    );
    assert!(model.links()[1].inertial.is_none());
}

#[test]
fn shapes_in_millimeters_are_doubtful() {
    let shape = r#"<collision><geometry><box size="40 113 95"/></geometry></collision>"#;
    check(
        &robot(shape, LIMIT),
        &[
            (
                Severity::Doubtful,
                "link `a` has shapes that are 153.0 m across",
            ),
            (
                Severity::Doubtful,
                "robot weighs nothing: no link has a mass",
            ),
        ],
    );
}

#[test]
fn limits_that_are_placeholders_are_doubtful() {
    use Severity::{Doubtful, Note};
    for (limit, expected) in [
        (
            r#"lower="0" upper="0" effort="1" velocity="1""#,
            vec![(Doubtful, "joint `j` is locked: its limits are both 0")],
        ),
        (
            r#"lower="-1" upper="1""#,
            vec![
                (Doubtful, "joint `j` has no effort limit: 0 Nm"),
                (Doubtful, "joint `j` has no velocity limit: 0 rad/s"),
            ],
        ),
        (
            r#"lower="-90" upper="90" effort="1" velocity="1""#,
            vec![(Doubtful, "joint `j` turns by up to 90 rad")],
        ),
        (
            r#"lower="0.5" upper="1" effort="1" velocity="1""#,
            vec![(Note, "joint `j` cannot be at 0: its limits are 0.5 and 1")],
        ),
    ] {
        check(&robot(&inertial(0.02, SOUND), limit), &expected);
    }
}

#[test]
fn mimic_joints_are_listed_with_their_numbers() {
    let xml = include_str!("golden/mimic_hand.urdf");
    let model = RobotModel::from_urdf(xml).unwrap();
    let followers: Vec<String> = model
        .examine()
        .iter()
        .filter(|finding| finding.problem.starts_with("is at"))
        .map(|finding| format!("{} {}", finding.part, finding.problem))
        .collect();
    assert_eq!(followers.len(), 6);
    assert_eq!(
        followers[5],
        "joint `thumb_distal_joint` is at -1.0672 times `thumb_pitch_joint`, plus 0.08666"
    );
}

/// Returns side, wrist, thumb's tip and the other tips in order.
fn shape(xml: &str) -> (&'static str, [f64; 3], String, String) {
    let model = RobotModel::from_urdf(xml).unwrap();
    let hand = model.hand_shape().unwrap();
    let tip = |finger: &robot::Finger| model.links()[finger.tip_link].name.clone();
    let tips: Vec<String> = hand.fingers.iter().map(tip).collect();
    (
        if hand.is_left { "left" } else { "right" },
        hand.wrist_offset_m.map(|x| (x * 1e4).round() / 1e4).into(),
        hand.thumb.as_ref().map(tip).unwrap_or_default(),
        tips.join(" "),
    )
}

#[test]
fn side_wrist_and_order_of_the_fingers_are_guessed() {
    let allegro = "link_3.0_tip link_7.0_tip link_11.0_tip";
    for (xml, side) in [
        (
            include_str!("../../../data/robots/allegro_right.urdf"),
            "right",
        ),
        (
            include_str!("../../../data/robots/allegro_left.urdf"),
            "left",
        ),
        (
            include_str!("../../../data/robots/xarm6_allegro.urdf"),
            "right",
        ),
    ] {
        let (found, wrist, thumb, tips) = shape(xml);
        assert_eq!((found, tips.as_str()), (side, allegro));
        assert_eq!(thumb, "link_15.0_tip");
        assert_eq!(wrist, [0.0, 0.0, -0.095]);
    }
    let (side, _, thumb, tips) = shape(include_str!("golden/mimic_hand.urdf"));
    assert_eq!((side, thumb.as_str()), ("right", "thumb_tip"));
    assert_eq!(tips, "index_tip middle_tip ring_tip pinky_tip");
}
