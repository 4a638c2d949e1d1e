//! URDFs that cannot be used say why, and the less common ones that can are read right.

use nalgebra::Point3;
use robot::{RobotError, RobotModel};

/// Returns a robot of these joints and the links `palm`, `a`, `b`.
fn robot(joints: &str) -> String {
    format!(
        r#"<robot name="r"><link name="palm"/><link name="a"/><link name="b"/>{joints}</robot>"#
    )
}

/// Returns a joint of this name and kind from `parent` to `child` with these further elements.
fn joint(name: &str, kind: &str, [parent, child]: [&str; 2], more: &str) -> String {
    format!(
        r#"<joint name="{name}" type="{kind}"><origin xyz="0 0 0.1"/><parent link="{parent}"/><child link="{child}"/>{more}</joint>"#
    )
}

const LIMIT: &str = r#"<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>"#;

fn refused(xml: &str) -> RobotError {
    RobotModel::from_urdf(xml).unwrap_err()
}

#[test]
fn rejects_what_is_not_xml() {
    for text in ["", "not a robot", "<robot name='r'><link name='a'>", "{}"] {
        let err = refused(text);
        assert!(
            matches!(err, RobotError::NotUrdf { .. } | RobotError::NoLink),
            "{text}: {err}"
        );
    }
}

#[test]
fn rejects_two_inertials_and_says_so() {
    let inertial = r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;
    let err = refused(&format!(
        r#"<robot name="r"><link name="a">{inertial}{inertial}</link></robot>"#
    ));
    assert!(matches!(err, RobotError::NotUrdf { .. }), "{err}");
    assert!(
        err.hint().is_some_and(|hint| hint.contains("<inertial>")),
        "{:?}",
        err.hint()
    );
}

#[test]
fn rejects_links_that_are_not_one_tree() {
    let pair = |ab: [&str; 2], ba: [&str; 2]| {
        robot(&(joint("j", "revolute", ab, LIMIT) + &joint("k", "revolute", ba, LIMIT)))
    };
    let err = refused(&pair(["palmm", "a"], ["a", "b"]));
    assert!(
        matches!(&err, RobotError::UnknownLink { role: "parent", .. }),
        "{err}"
    );
    assert_eq!(err.hint().unwrap(), "did you mean `palm`?");
    assert!(matches!(
        refused(&pair(["a", "b"], ["b", "a"])),
        RobotError::Loop { .. }
    ));
    assert!(matches!(
        refused(&pair(["a", "b"], ["palm", "b"])),
        RobotError::TwoParents { .. }
    ));
    assert!(matches!(
        refused(&robot(&joint("j", "revolute", ["palm", "a"], LIMIT))),
        RobotError::TwoRoots { .. }
    ));
    assert!(matches!(
        refused(&robot(
            &(joint("j", "fixed", ["palm", "a"], "") + &joint("j", "fixed", ["a", "b"], ""))
        )),
        RobotError::Duplicate { what: "joint", .. }
    ));
    // A loop beside the tree.
    let triangle = joint("j", "fixed", ["a", "b"], "") + &joint("k", "fixed", ["b", "a"], "");
    assert!(matches!(
        refused(&robot(&triangle)),
        RobotError::Loop { .. }
    ));
}

#[test]
fn rejects_joints_that_cannot_be_used() {
    let one = |kind: &str, more: &str| {
        robot(&(joint("j", kind, ["palm", "a"], more) + &joint("k", "fixed", ["a", "b"], "")))
    };
    for more in [
        "",
        r#"<limit effort="1" velocity="1"/>"#,
        r#"<limit lower="0" upper="0" effort="1" velocity="1"/>"#,
        r#"<limit lower="1" upper="-1" effort="1" velocity="1"/>"#,
        r#"<limit lower="nan" upper="1" effort="1" velocity="1"/>"#,
    ] {
        let err = refused(&one("revolute", more));
        assert!(
            matches!(&err, RobotError::BadLimits { joint, .. } if joint == "j"),
            "{err}"
        );
        assert!(err.hint().unwrap().contains("continuous"));
    }
    assert!(matches!(
        refused(&one("floating", "")),
        RobotError::UnsupportedJoint { .. }
    ));
    assert!(matches!(
        refused(&one("continuous", r#"<axis xyz="0 0 0"/>"#)),
        RobotError::ZeroAxis { .. }
    ));
    let mimic = LIMIT.to_owned() + r#"<mimic joint="j"/>"#;
    assert!(matches!(
        refused(&one("revolute", &mimic)),
        RobotError::BadMimic { .. }
    ));
    assert!(RobotModel::from_urdf(&one("continuous", "")).is_ok());
}

#[test]
fn mimic_joints_follow_their_master() {
    let mimic = LIMIT.to_owned() + r#"<mimic joint="j" multiplier="2" offset="0.1"/>"#;
    let model = RobotModel::from_urdf(&robot(
        &(joint("k", "revolute", ["a", "b"], &mimic)
            + &joint("j", "revolute", ["palm", "a"], LIMIT)),
    ))
    .unwrap();
    assert_eq!(model.joint_names(), ["j"]);
    let b = model.link("b").unwrap();
    let palm_from_b = |q: f64| model.forward_kinematics(&[q]).unwrap()[b];
    // j turns a by 0.2, k turns b by another 2 · 0.2 + 0.1.
    assert!((palm_from_b(0.2).rotation.angle() - 0.7).abs() < 1e-12);
    let point = Point3::new(0.0, 0.0, 0.3);
    let links = model.forward_kinematics(&[0.2]).unwrap();
    let jacobian = model.point_jacobian(&links, b, &(palm_from_b(0.2) * point));
    let numeric = (palm_from_b(0.2 + 1e-6) * point - palm_from_b(0.2 - 1e-6) * point) / 2e-6;
    assert!((jacobian.column(0) - numeric).norm() < 1e-6);
}

#[test]
fn meshes_are_never_opened() {
    let xml = r#"<robot name="r"><link name="a"><collision><geometry><mesh filename="package://none/a.stl"/></geometry></collision></link></robot>"#;
    let model = RobotModel::from_urdf(xml).unwrap();
    assert!(model.links()[0].collisions.is_empty());
    assert!(model.links()[0].inertial.is_none());
}
