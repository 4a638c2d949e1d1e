//! Robots are the same as `urdf-rs` reads them from their own texts, and those that it refuses are repaired.

use std::{fs, path::PathBuf};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use robot::{JointKind, RobotModel};

/// The URDFs that come with the project.
fn ours() -> Vec<PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    let folders = ["../../../data/robots", "tests/golden"].map(|folder| format!("{root}{folder}"));
    let files = folders
        .iter()
        .flat_map(|folder| fs::read_dir(folder).unwrap());
    let paths = files.map(|entry| entry.unwrap().path());
    paths
        .filter(|path| path.extension().is_some_and(|end| end == "urdf"))
        .collect()
}

#[test]
fn repairs_change_nothing_of_robots_that_need_none() {
    let paths = ours();
    assert!(paths.len() >= 5, "{paths:?}");
    for path in paths {
        let text = fs::read_to_string(&path).unwrap();
        let model = RobotModel::from_urdf(&text).unwrap();
        let other = urdf_rs::read_from_string(&text).unwrap();
        let name = path.display();
        assert_eq!(model.links().len(), other.links.len(), "{name}");
        let mut n_independent = 0;
        for theirs in &other.joints {
            let link = model.require_link(&theirs.child.link).unwrap();
            let link = &model.links()[link];
            let parent = &model.links()[link.parent.unwrap()];
            assert_eq!(parent.name, theirs.parent.link, "{name}");
            let kind = match theirs.joint_type {
                urdf_rs::JointType::Revolute => Some(JointKind::Revolute),
                urdf_rs::JointType::Continuous => Some(JointKind::Continuous),
                urdf_rs::JointType::Prismatic => Some(JointKind::Prismatic),
                _ => None,
            };
            // A joint without end that others follow is limited by them.
            let is_limited =
                kind == Some(JointKind::Continuous) && link.kind == Some(JointKind::Revolute);
            assert!(link.kind == kind || is_limited, "{name}: {}", theirs.name);
            let [x, y, z] = *theirs.origin.xyz;
            let [roll, pitch, yaw] = *theirs.origin.rpy;
            let origin = Isometry3::from_parts(
                Translation3::new(x, y, z),
                UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            );
            let off = *link.parent_from_joint.inverse() * origin;
            assert!(
                off.translation.vector.norm() + off.rotation.angle() < 1e-7,
                "{name}"
            );
            if kind.is_some() {
                let axis = Vector3::from(*theirs.axis.xyz).normalize();
                assert!((link.axis.into_inner() - axis).norm() < 1e-12, "{name}");
            }
            if kind.is_some() && theirs.mimic.is_none() {
                n_independent += 1;
                let joint = &model.joints()[model.joint(&theirs.name).unwrap()];
                if kind != Some(JointKind::Continuous) {
                    // What follows a joint may narrow its limits.
                    assert!(joint.lower >= theirs.limit.lower, "{name}: {}", theirs.name);
                    assert!(joint.upper <= theirs.limit.upper, "{name}: {}", theirs.name);
                }
                assert_eq!(joint.effort, theirs.limit.effort, "{name}: {}", theirs.name);
                assert_eq!(
                    joint.velocity, theirs.limit.velocity,
                    "{name}: {}",
                    theirs.name
                );
            }
        }
        assert_eq!(n_independent, model.dof(), "{name}");
        for theirs in &other.links {
            let link = &model.links()[model.link(&theirs.name).unwrap()];
            let mass = link
                .inertial
                .as_ref()
                .map_or(0.0, |inertial| inertial.mass_kg);
            assert_eq!(mass, theirs.inertial.mass.value, "{name}: {}", theirs.name);
        }
    }
}

#[test]
fn what_urdf_rs_refuses_is_repaired() {
    let link = |inside: &str| format!("<robot name='r'><link name='a'>{inside}</link></robot>");
    let inertial = "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>";
    let joint = |inside: &str| {
        format!(
            "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='revolute'>\
             <parent link='a'/><child link='b'/>{inside}</joint></robot>"
        )
    };
    for (text, n_findings) in [
        (link(&inertial.repeat(2)), 1),
        (link(&inertial.replace("ixy='0'", "")), 0),
        (link("<inertial><mass value='1'/></inertial>"), 0),
        (link("<inertial/>"), 1),
        (link("<visual/><collision/>"), 0),
        (
            link("<collision><geometry><ellipsoid/></geometry></collision>"),
            1,
        ),
        (
            link(
                "<collision><geometry><box size='1 1 1'/><mesh filename='a'/></geometry></collision>",
            ),
            0,
        ),
        (joint("<limit lower='0' upper='1'/>"), 0),
        (
            joint("<limit lower='0' upper='1' velocity='1'/>")
                .replace("<parent", "<origin/><origin/><parent"),
            0,
        ),
        (joint("<axis/><limit upper='1' velocity='1'/>"), 0),
    ] {
        assert!(urdf_rs::read_from_string(&text).is_err(), "{text}");
        let model = RobotModel::from_urdf(&text).unwrap();
        assert_eq!(model.findings().len(), n_findings, "{text}");
    }
}

#[test]
fn characters_that_xml_forbids_are_refused() {
    let text = "<robot name='r'><link name='a\u{1}'/></robot>";
    let err = RobotModel::from_urdf(text).unwrap_err();
    assert_eq!(err.to_string(), "`urdf-rs` refuses the URDF");
    assert!(err.hint().unwrap().contains("control characters"));
}
