//! Findings about unphysical robots, with their numbers; none about sound ones.

use robot::{RobotModel, Severity};

/// A robot whose link `a` turns on `palm` and has these elements; its joint has these limits.
fn robot(link: &str, limit: &str) -> RobotModel {
    let palm = inertial(0.02, SOUND);
    let xml = format!(
        r#"<robot name="r"><link name="palm">{palm}</link><link name="a">{link}</link><joint name="j" type="revolute"><origin xyz="0 0 0.1"/><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/><limit {limit}/></joint></robot>"#
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
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/robots");
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
fn unphysical_inertias_are_errors() {
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
            "has an inertia that violates the triangle inequality: principal moments 1.000e-5, \
             1.000e-5, 3.000e-5 kg m², the largest exceeds the sum of the others",
        ),
        (
            [1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0],
            Doubtful,
            "has a radius of gyration of 100.0 mm, and its shapes end 24.5 mm from its center of \
             mass",
        ),
    ] {
        let model = robot(&inertial(0.02, moments), LIMIT);
        let words = format!("link `a` {problem}");
        check(&model, &[(severity, words.as_str())]);
    }
}

#[test]
fn implausible_masses_are_doubtful() {
    check(
        &robot(&inertial(0.06, SOUND), LIMIT),
        &[(
            Severity::Doubtful,
            "link `a` has its center of mass 20.0 mm outside the box about its shapes",
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
            (Severity::Doubtful, WITHOUT),
        ],
    );
}

/// The findings about link `a` if it has no inertia.
const WITHOUT: &str =
    "link `a` moves and has no inertia, nor has what is fixed to it: `screen` refuses it";

#[test]
fn links_without_inertia_are_named() {
    check(&robot("", LIMIT), &[(Severity::Doubtful, WITHOUT)]);
    let sound = inertial(0.02, SOUND);
    // Links that are fixed to a link give it their inertia, and a root needs none.
    let xml = |root: &str, a: &str, fixed: &str| {
        format!(
            r#"<robot name="r"><link name="root">{root}</link><link name="a">{a}</link><link name="f">{fixed}</link>
            <joint name="j" type="revolute"><parent link="root"/><child link="a"/><axis xyz="0 1 0"/><limit {LIMIT}/></joint>
            <joint name="k" type="fixed"><parent link="a"/><child link="f"/></joint></robot>"#
        )
    };
    let root = "link `root` has no inertia, nor has what is fixed to it: in physics it has that of all \
                that it carries";
    for (xml, expected) in [
        (xml(&sound, "", &sound), vec![]),
        (xml(&sound, &sound, ""), vec![]),
        (xml(&sound, "", ""), vec![(Severity::Doubtful, WITHOUT)]),
        (xml("", "", &sound), vec![(Severity::Note, root)]),
        (
            xml("", "", ""),
            vec![(
                Severity::Doubtful,
                "robot weighs nothing: no link has a mass",
            )],
        ),
    ] {
        check(&RobotModel::from_urdf(&xml).unwrap(), &expected);
    }
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
    let hand = model.hand_layout().unwrap();
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
            include_str!("../../../../data/robots/allegro_right.urdf"),
            "right",
        ),
        (
            include_str!("../../../../data/robots/allegro_left.urdf"),
            "left",
        ),
        (
            include_str!("../../../../data/robots/xarm6_allegro.urdf"),
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

/// A hand of four fingers along z that bend towards x, and a thumb that begins on the side of the
/// little finger, as where some hands oppose it; `side` is −1 for its mirror image.
fn opposed(robot: &str, fingers: [&str; 4], side: f64) -> String {
    let link = |name: &str| format!(r#"<link name="{name}">{BOX}</link>"#);
    let joint = |name: &str, parent: &str, child: &str, at: [f64; 3], axis: &str| {
        let [x, y, z] = at;
        format!(
            r#"<joint name="{name}" type="revolute"><origin xyz="{x} {y} {z}"/><parent link="{parent}"/>
            <child link="{child}"/><axis xyz="{axis}"/><limit lower="0" upper="1.5" effort="1" velocity="1"/></joint>"#
        )
    };
    let mut xml = format!(r#"<robot name="{robot}">{}"#, link("palm"));
    for (finger, y) in fingers.iter().zip([0.03, 0.01, -0.01, -0.03]) {
        let end = format!("{finger}_end");
        xml += &(link(finger) + &link(&end));
        xml += &joint(
            &format!("{finger}_j"),
            "palm",
            finger,
            [0.0, side * y, 0.1],
            "0 1 0",
        );
        xml += &joint(
            &format!("{finger}_k"),
            finger,
            &end,
            [0.0, 0.0, 0.04],
            "0 1 0",
        );
    }
    xml += &(link("thumb") + &link("thumb_end"));
    xml += &joint(
        "thumb_j",
        "palm",
        "thumb",
        [0.01, side * -0.02, 0.02],
        "0 0 1",
    );
    xml += &joint("thumb_k", "thumb", "thumb_end", [0.03, 0.0, 0.02], "0 1 0");
    xml + "</robot>"
}

#[test]
fn names_say_side_and_fingers_where_the_tree_misleads() {
    let named = ["index", "middle", "ring", "pinky"];
    let tips = "index_end middle_end ring_end pinky_end";
    let of = |robot: &str, fingers: [&str; 4], side: f64| {
        let (found, _, thumb, tips) = shape(&opposed(robot, fingers, side));
        assert_eq!(thumb, "thumb_end");
        (found, tips)
    };
    assert_eq!(of("r", named, 1.0), ("right", tips.to_owned()));
    assert_eq!(of("r", named, -1.0), ("left", tips.to_owned()));
    // In whatever words and letters.
    for fingers in [
        [
            "r_Index_Finger",
            "r_Middle_Finger",
            "r_Ring_Finger",
            "r_Pinkie",
        ],
        ["ffproximal", "mfproximal", "rfproximal", "lfproximal"],
        [
            "link_index_1",
            "link_middle_1",
            "link_ring_1",
            "link_little_1",
        ],
    ] {
        let tips = fingers.map(|finger| format!("{finger}_end")).join(" ");
        assert_eq!(of("r", fingers, 1.0), ("right", tips.clone()));
        assert_eq!(of("r", fingers, -1.0), ("left", tips));
    }
    // Without them the thumb's place misleads, but for the side if that is named.
    let unnamed = ["f1", "f2", "f3", "f4"];
    let backwards = "f4_end f3_end f2_end f1_end";
    assert_eq!(
        of("a_right_hand", unnamed, 1.0),
        ("right", backwards.to_owned())
    );
    assert_eq!(of("LH", unnamed, -1.0).0, "left");
    // Names that are all one, or of other things, say nothing.
    for fingers in [
        ["ring_1", "ring_2", "ring_3", "ring_4"],
        ["spring", "lfinger", "rfinger", "wring"],
    ] {
        let tips: Vec<String> = fingers
            .iter()
            .rev()
            .map(|finger| format!("{finger}_end"))
            .collect();
        assert_eq!(of("r", fingers, 1.0).1, tips.join(" "));
    }
}
