//! URDFs that cannot be used say why, and the less common ones that can are read right.

use nalgebra::Point3;
use robot::{JointKind, MimicFault, RobotError, RobotModel};
use spatial::Palm;

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

/// Checks that a text is refused with this message and a hint that has these words in it.
fn check_refused(xml: &str, message: &str, hint: &str) {
    let err = refused(xml);
    assert_eq!(err.to_string(), message);
    assert!(
        err.hint().unwrap_or_default().contains(hint),
        "{message}: {:?}",
        err.hint()
    );
}

#[test]
fn text_other_than_urdf_is_refused() {
    let no_robot = "the text is not one `<robot>`";
    check_refused("", no_robot, "SDF and MJCF");
    check_refused("not a robot", no_robot, "SDF and MJCF");
    check_refused("{}", no_robot, "");
    check_refused(
        "<mujoco model='hand'><worldbody/></mujoco>",
        "the text is not one `<robot>`: `<mujoco>` stands there",
        "SDF and MJCF",
    );
    check_refused(
        "<robot name='r'><link name='a'/></robot>\n<robot name='s'/>",
        "the text is not one `<robot>`: `<robot>` stands there",
        "",
    );
    check_refused("<robot name='r'/>", "the URDF has no link", "give a URDF");
    check_refused(
        "<robot name='r'>\n<link name='a'>",
        "the URDF ends before `<link>` of line 2 is closed",
        "",
    );
    for text in [
        "<robot name='r'>\n<link name='a'></joint></robot>",
        "<robot name='r'>\n<link name='a' name='b'/></robot>",
        "<robot name='r'>\n<link name='&bomb;'/></robot>",
        "<robot name='r'>\n<link name='a' <</robot>",
    ] {
        check_refused(text, "line 2 of the URDF is not XML", "");
        assert!(std::error::Error::source(&refused(text)).is_some());
    }
    check_refused(
        "<robot name='r'>\n\n<link/></robot>",
        "`<link>` on line 3 has no `name`",
        "",
    );
    let utf_16: Vec<u8> = "<robot/>"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let err =
        RobotModel::from_urdf_bytes(&[&[0xff, 0xfe], utf_16.as_slice()].concat()).unwrap_err();
    assert_eq!(err.to_string(), "the URDF is not UTF-8 from byte 0 on");
    assert!(err.hint().unwrap().contains("iconv"));
    // A byte order mark is not a mistake.
    let marked = "\u{feff}<?xml version='1.0'?><robot name='r'><link name='a'/></robot>";
    assert!(RobotModel::from_urdf_bytes(marked.as_bytes()).is_ok());
}

#[test]
fn declarations_are_refused_before_anything_is_expanded() {
    let bomb = "<?xml version='1.0'?>\n<!DOCTYPE robot [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]>\n\
                <robot name='&b;'><link name='a'/></robot>";
    check_refused(
        bomb,
        "line 2 of the URDF is a document type declaration, which is never read",
        "remove",
    );
    check_refused(
        "<!DOCTYPE robot SYSTEM 'file:///etc/passwd'><robot name='r'><link name='a'/></robot>",
        "line 1 of the URDF is a document type declaration, which is never read",
        "remove",
    );
}

#[test]
fn templates_are_sent_to_xacro() {
    let xml =
        "<robot name='r' xmlns:xacro='x'>\n<xacro:include filename='b'/><link name='a'/></robot>";
    check_refused(
        xml,
        "`<xacro:include>` on line 2 is an instruction for xacro",
        "xacro robot.urdf.xacro",
    );
    let xml = robot(&joint("j", "fixed", ["palm", "a"], "")).replace("0 0 0.1", "0 0 ${height}");
    check_refused(
        &xml,
        "`xyz` of `<origin>` on line 1 is `0 0 ${height}`, which xacro fills in",
        "xacro robot.urdf.xacro",
    );
    // In names and paths, too, which are no numbers.
    for (before, after, part) in [
        (
            "name=\"palm\"",
            "name=\"${prefix}palm\"",
            "`name` of `<link>` on line 1 is `${prefix}palm`, which xacro fills in",
        ),
        (
            "<link name=\"palm\"/>",
            "<link name=\"palm\"><collision><geometry><mesh filename=\"$(find hand)/p.stl\"/></geometry></collision></link>",
            "`filename` of `<mesh>` on line 1 is `$(find hand)/p.stl`, which xacro fills in",
        ),
    ] {
        let xml = robot(&joint("j", "fixed", ["palm", "a"], ""));
        assert!(xml.contains(before), "{xml}");
        check_refused(
            &xml.replacen(before, after, 1),
            part,
            "xacro robot.urdf.xacro",
        );
    }
}

/// Returns so many texts in one.
fn each(n: usize, text: impl Fn(usize) -> String) -> String {
    (0..n).map(text).collect()
}

#[test]
fn huge_and_deep_texts_take_little_time() {
    check_refused(
        &format!("<robot>{}</robot>", " ".repeat(17 << 20)),
        "the URDF has more than 16777216 bytes",
        "one robot alone",
    );
    check_refused(
        &format!("<robot>{}</robot>", "<a/>".repeat(200_001)),
        "the URDF has more than 200000 elements",
        "",
    );
    let many = each(5001, |idx| format!("<link name='{idx}'/>"));
    check_refused(
        &format!("<robot>{many}</robot>"),
        "the URDF has more than 5000 links or joints",
        "",
    );
    // Elements in each other, as deep as they go, are passed over: none of them means anything.
    let deep = "<a>".repeat(1_000_000) + &"</a>".repeat(1_000_000);
    let xml = format!("<robot name='r'><link name='a'/>{deep}</robot>");
    assert!(RobotModel::from_urdf(&xml).is_ok());
    // A chain of links, as deep as it goes: nothing may call itself once for each.
    let links = each(5000, |idx| format!("<link name='l{idx}'/>"));
    let joints: String = (0..4999)
        .map(|idx| {
            let follows = if idx == 0 {
                String::new()
            } else {
                format!(r#"<mimic joint="j{}"/>"#, idx - 1)
            };
            joint(
                &format!("j{idx}"),
                "continuous",
                [&format!("l{idx}"), &format!("l{}", idx + 1)],
                &follows,
            )
        })
        .collect();
    let model = RobotModel::from_urdf(&format!("<robot>{links}{joints}</robot>")).unwrap();
    assert_eq!((model.dof(), model.links().len()), (1, 5000));
    assert_eq!(model.fingers().len(), 1);
    assert_eq!(
        model.forward_kinematics::<Palm>(&[0.1]).unwrap().len(),
        5000
    );
}

/// Returns what was found about the robot's parts, in words.
fn found(model: &RobotModel) -> Vec<String> {
    let words = |finding: &robot::Finding| format!("{} {}", finding.part, finding.problem);
    model.findings().iter().map(words).collect()
}

#[test]
fn first_of_two_inertials_counts() {
    let inertial = |mass: f64| {
        format!(
            r#"<inertial><mass value="{mass}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#
        )
    };
    let xml = format!(
        r#"<robot name="r"><link name="a">{}{}</link></robot>"#,
        inertial(1.0),
        inertial(2.0)
    );
    let model = RobotModel::from_urdf(&xml).unwrap();
    assert_eq!(model.links()[0].inertial.as_ref().unwrap().mass_kg, 1.0);
    assert_eq!(
        found(&model),
        ["link `a` has 2 `<inertial>` elements; the first one counts"]
    );
    let negative = xml.replace("value=\"1\"", "value=\"-1\"");
    check_refused(&negative, "link `a` has a mass of -1 kg", "");
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

/// A joint `j` of this kind with these further elements, and a fixed `k`.
fn one(kind: &str, more: &str) -> String {
    robot(&(joint("j", kind, ["palm", "a"], more) + &joint("k", "fixed", ["a", "b"], "")))
}

#[test]
fn rejects_joints_that_cannot_be_used() {
    check_refused(
        &one(
            "revolute",
            r#"<limit lower="1" upper="-1" effort="1" velocity="1"/>"#,
        ),
        "the limits of joint `j` are swapped: lower 1, upper -1",
        r#"lower="-1" upper="1""#,
    );
    for number in ["nan", "inf", "1e300", "x"] {
        check_refused(
            &one(
                "revolute",
                &format!(r#"<limit lower="{number}" upper="1"/>"#),
            ),
            &format!("`lower` of `<limit>` on line 1 is `{number}`, not a usable number"),
            "",
        );
        check_refused(
            &one("fixed", "").replace("0 0 0.1", &format!("0 {number} 0")),
            &format!("`xyz` of `<origin>` on line 1 is `0 {number} 0`, not three usable numbers"),
            "",
        );
    }
    for bound in ["-1", "nan"] {
        check_refused(
            &one(
                "revolute",
                &format!(r#"<limit upper="1" effort="{bound}"/>"#),
            ),
            &format!("`effort` of `<limit>` on line 1 is `{bound}`, not a usable number"),
            "",
        );
    }
    check_refused(
        &one("prismatic", ""),
        "prismatic joint `j` on line 1 has no limits",
        "in meters",
    );
    check_refused(
        &one("floating", ""),
        "joint `j` on line 1 is `floating`, expected revolute, continuous, prismatic or fixed",
        "root moves freely",
    );
    check_refused(
        &one("continuous", r#"<axis xyz="0 0 0"/>"#),
        "the axis of joint `j` is zero",
        "<axis",
    );
    check_refused(
        &one("fixed", "").replace(r#"<parent link="palm"/>"#, ""),
        "joint `j` on line 1 has no `<parent link=…>`",
        "",
    );
}

#[test]
fn limits_that_are_missing_or_equal_are_read() {
    for more in ["", "<limit effort='1' velocity='1'/>"] {
        let model = RobotModel::from_urdf(&one("revolute", more)).unwrap();
        assert_eq!(model.joints()[0].kind, JointKind::Continuous);
        assert_eq!(
            found(&model),
            ["joint `j` is revolute without limits; it is taken to turn without end"]
        );
    }
    let locked = one(
        "revolute",
        "<limit lower='0' upper='0' effort='1' velocity='1'/>",
    );
    let model = RobotModel::from_urdf(&locked).unwrap();
    assert_eq!(
        (model.joints()[0].lower, model.joints()[0].upper),
        (0.0, 0.0)
    );
    // As `urdfdom` has it, one that is missing is 0.
    let model = RobotModel::from_urdf(&one("prismatic", "<limit upper='0.1'/>")).unwrap();
    assert_eq!(
        (model.joints()[0].lower, model.joints()[0].upper),
        (0.0, 0.1)
    );
    let model = RobotModel::from_urdf(&one("continuous", "")).unwrap();
    assert_eq!(model.findings(), []);
    // The axis that a URDF means if it says none.
    assert_eq!(model.links()[1].axis.x, 1.0);
}

#[test]
fn rejects_infeasible_motions() {
    let mimic = |master: &str| format!(r#"{LIMIT}<mimic joint="{master}" multiplier="1e9"/>"#);
    for (master, reason, hint) in [
        ("j", "follows it in turn", "follow a joint that moves"),
        ("k", "is fixed", "follow a joint that moves"),
        ("jj", "does not exist", "did you mean `j`?"),
    ] {
        check_refused(
            &one("revolute", &mimic(master)),
            &format!("joint `j` mimics `{master}`, which {reason}"),
            hint,
        );
    }
    let pair = joint("j", "revolute", ["palm", "a"], &mimic("k"))
        + &joint("k", "revolute", ["a", "b"], &mimic("j"));
    assert!(matches!(
        refused(&robot(&pair)),
        RobotError::BadMimic {
            fault: MimicFault::Loop,
            ..
        }
    ));
}

#[test]
fn masters_stay_where_their_followers_are_inside_their_limits() {
    let pair = |multiplier: f64, offset: f64| {
        let mimic = format!(
            r#"<limit lower="0" upper="1"/><mimic joint="j" multiplier="{multiplier}" offset="{offset}"/>"#
        );
        let limit = r#"<limit lower="-1" upper="2"/>"#;
        let xml = robot(
            &(joint("k", "revolute", ["a", "b"], &mimic)
                + &joint("j", "revolute", ["palm", "a"], limit)),
        );
        let model = RobotModel::from_urdf(&xml).unwrap();
        let [joint] = model.joints() else {
            panic!("one joint")
        };
        (joint.lower, joint.upper, found(&model))
    };
    let (lower, upper, findings) = pair(2.0, 0.5);
    assert_eq!((lower, upper), (-0.25, 0.25));
    assert_eq!(
        findings,
        [
            "joint `k` reaches its limits before `j`, which it follows: that one is kept within -0.2500 to 0.2500"
        ]
    );
    assert_eq!(pair(-1.0, 0.0).0, -1.0);
    assert_eq!(pair(-1.0, 0.0).1, 0.0);
    // One that turns without end gets limits.
    let mimic = r#"<limit lower="0" upper="1"/><mimic joint="j" multiplier="2"/>"#;
    let xml = robot(
        &(joint("j", "continuous", ["palm", "a"], "") + &joint("k", "revolute", ["a", "b"], mimic)),
    );
    let model = RobotModel::from_urdf(&xml).unwrap();
    let master = &model.joints()[0];
    assert_eq!(
        (master.kind, master.lower, master.upper),
        (JointKind::Revolute, 0.0, 0.5)
    );
    assert_eq!(model.links()[master.link].kind, Some(JointKind::Revolute));
    // One that cannot be inside its own limits does not stop its master.
    let (lower, upper, findings) = pair(1.0, 10.0);
    assert_eq!((lower, upper), (-1.0, 2.0));
    assert!(
        findings[0].contains("outside its own limits"),
        "{findings:?}"
    );
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
    let palm_from_b = |q: f64| model.forward_kinematics::<Palm>(&[q]).unwrap()[b];
    // j turns a by 0.2, k turns b by another 2 · 0.2 + 0.1.
    assert!((palm_from_b(0.2).rotation.angle() - 0.7).abs() < 1e-12);
    let point = Point3::new(0.0, 0.0, 0.3);
    let links = model.forward_kinematics::<Palm>(&[0.2]).unwrap();
    let jacobian = model.geometric_jacobian(&links, b, &(palm_from_b(0.2) * point));
    let numeric = (palm_from_b(0.2 + 1e-6) * point - palm_from_b(0.2 - 1e-6) * point) / 2e-6;
    assert!((jacobian.column(0).fixed_rows::<3>(0) - numeric).norm() < 1e-6);
}

#[test]
fn invalid_shapes_are_skipped_with_a_finding() {
    let shapes = [
        "<box size='0 0 0'/>",
        "<sphere radius='-1'/>",
        "<drake:ellipsoid a='1'/>",
    ];
    for shape in shapes {
        let xml = format!(
            "<robot name='r'><link name='a'><collision><geometry>{shape}</geometry></collision>\
             <collision><geometry><capsule radius='1' length='0'/></geometry></collision></link></robot>"
        );
        let model = RobotModel::from_urdf(&xml).unwrap();
        assert_eq!(model.links()[0].collisions.len(), 1, "{shape}");
        let (name, _) = shape[1..].split_once(' ').unwrap();
        assert_eq!(
            found(&model),
            [format!(
                "link `a` has a `<{name}>` on line 1 that is not a shape with a volume; it is passed over"
            )]
        );
    }
    check_refused(
        "<robot name='r'><link name='a'><collision><geometry><sphere/></geometry></collision></link></robot>",
        "`<sphere>` on line 1 has no `radius`",
        "",
    );
}

#[test]
fn meshes_are_never_opened() {
    let xml = r#"<robot name="r"><link name="a"><collision><geometry><mesh filename="package://none/a.stl"/></geometry></collision></link></robot>"#;
    let model = RobotModel::from_urdf(xml).unwrap();
    assert!(model.links()[0].collisions.is_empty());
    assert_eq!(model.links()[0].meshes[0].file, "package://none/a.stl");
    assert!(model.links()[0].inertial.is_none());
}

/// Returns the published descriptions that this machine has, by their names.
fn published() -> Vec<(String, String)> {
    let Some(folder) = measured_data::folder("urdf") else {
        return Vec::new();
    };
    let entries = std::fs::read_dir(&folder).unwrap();
    entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "urdf")
        })
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, std::fs::read_to_string(&path).unwrap())
        })
        .collect()
}

#[test]
fn published_descriptions_are_read() {
    for (name, xml) in published() {
        let model = RobotModel::from_urdf(&xml).unwrap_or_else(|err| panic!("{name}: {err}"));
        let (dof, n_fingers, thumb) = match name.as_str() {
            "allegro_hand_free" | "xarm6_allegro" => (22, 4, "link_15.0_tip"),
            "allegro_hand_left" | "allegro_hand_right" => (16, 4, "link_15.0_tip"),
            "leap_hand_right" => (16, 4, "thumb_tip_head"),
            "shadow_hand_right" => (24, 5, "thtip"),
            _ => continue,
        };
        assert_eq!(model.dof(), dof, "{name}");
        let fingers = model.fingers();
        assert_eq!(fingers.len(), n_fingers, "{name}");
        let thumbs: Vec<&str> = fingers
            .iter()
            .filter(|finger| finger.is_thumb)
            .map(|finger| model.links()[finger.tip_link].name.as_str())
            .collect();
        assert_eq!(thumbs, [thumb], "{name}");
    }
}

#[test]
fn a_macro_left_anywhere_is_named_with_its_line() {
    for inside in [
        "<xacro:finger name='a'/>",
        "<link name='b'>\n<xacro:inertial mass='1'/></link>",
        "<link name='b'><collision><geometry>\n<xacro:tip/></geometry></collision></link>",
        "<gazebo><a><b><c><d><e>\n<xacro:sensor/></e></d></c></b></a></gazebo>",
    ] {
        let text = format!("<robot name='r'><link name='a'/>{inside}</robot>");
        let err = RobotModel::from_urdf(&text).unwrap_err();
        let line = 1 + inside.matches('\n').count();
        let RobotError::Xacro { line: found, .. } = err else {
            panic!("{inside}: {err}");
        };
        assert_eq!(found, line, "{inside}");
        assert!(err.hint().unwrap().contains("xacro robot.urdf.xacro"));
    }
}

#[test]
fn bytes_in_another_encoding_are_refused_with_its_name() {
    let declared = |encoding: &str| {
        let mut bytes = format!("<?xml version=\"1.0\" encoding={encoding}?><!-- Gr").into_bytes();
        bytes.extend(b"\xfc\xdfe --><robot name=\"r\"/>");
        bytes
    };
    let utf_16: Vec<u8> = "<robot/>"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    for (bytes, encoding) in [
        (declared("\"ISO-8859-1\""), "ISO-8859-1"),
        (declared("'windows-1252' "), "windows-1252"),
        (declared(" \"GBK\" standalone=\"yes\""), "GBK"),
        // What they declare is not so, or is no name.
        (declared("\"UTF-8\""), "ISO-8859-1"),
        (declared("\"$(reboot)\""), "ISO-8859-1"),
        (b"<!-- \xfc --><robot/>".to_vec(), "ISO-8859-1"),
        ([b"\xff\xfe".to_vec(), utf_16].concat(), "UTF-16"),
    ] {
        let err = RobotModel::from_urdf_bytes(&bytes).unwrap_err();
        let hint = err.hint().unwrap();
        assert!(
            hint.contains(&format!("iconv -f {encoding} -t UTF-8")),
            "{hint}"
        );
    }
}

/// The primitives of the LEAP and the Shadow hang where the published links do.
#[test]
fn our_hands_have_the_kinematics_of_the_published_ones() {
    for (name, theirs) in published() {
        let (ours, palm) = match name.as_str() {
            "leap_hand_right" => (
                include_str!("../../../../data/robots/leap_right.urdf"),
                "base",
            ),
            "shadow_hand_right" => (
                include_str!("../../../../data/robots/shadow_right.urdf"),
                "palm",
            ),
            _ => continue,
        };
        let [ours, theirs] = [ours, theirs.as_str()].map(|xml| RobotModel::from_urdf(xml).unwrap());
        // Every joint by its name; those of the Shadow's last links follow the ones before them.
        let position = |model: &RobotModel, joint: usize| {
            let name = model.joints()[joint].name.replace("FJ1", "FJ2");
            let sum: usize = name.bytes().map(usize::from).sum();
            if name.starts_with("WRJ") {
                0.0
            } else {
                0.1 + (sum % 7) as f64 / 10.0
            }
        };
        let poses = [&ours, &theirs].map(|model| {
            let poses = model.link_poses::<Palm>(|joint| position(model, joint));
            let palm = poses[model.link(palm).unwrap()];
            (model, palm, poses)
        });
        let [(_, our_palm, our_poses), (_, their_palm, their_poses)] = &poses;
        for (link, pose) in ours.links().iter().zip(our_poses) {
            let there = &their_poses[theirs.link(&link.name).unwrap()];
            let [here, there] = [(our_palm, pose), (their_palm, there)]
                .map(|(palm, pose)| *palm.inverse() * **pose);
            let off = here.inverse() * there;
            assert!(
                off.translation.vector.norm() < 2e-5 && off.rotation.angle() < 1e-4,
                "{name}: {}: {off}",
                link.name
            );
        }
        for joint in ours.joints() {
            let other = &theirs.joints()[theirs.joint(&joint.name).unwrap()];
            assert!((joint.lower - other.lower).abs() < 1e-5, "{}", joint.name);
            assert!((joint.upper - other.upper).abs() < 1e-5, "{}", joint.name);
        }
    }
}
