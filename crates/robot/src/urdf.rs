//! From the text of a URDF to a tree of links.

mod mimic;
mod numbers;
mod parts;
mod tree;
mod xml;

pub use self::xml::MAX_BYTES;

use nalgebra::Vector3;
use spatial::Pose;

use self::parts::RawJoint;
use crate::{Joint, JointKind, Link, RobotError, RobotModel};

/// Maximum number of links that are read, a hundred times those of a hand with an arm.
const MAX_LINKS: usize = 5000;

/// Reads a robot from the text of its URDF.
pub(crate) fn parse(text: &str) -> Result<RobotModel, RobotError> {
    let robot = xml::read(text)?;
    if robot.all("link").count() > MAX_LINKS || robot.all("joint").count() > MAX_LINKS {
        return Err(RobotError::TooLarge {
            what: "links or joints",
            limit: MAX_LINKS,
        });
    }
    let mut findings = Vec::new();
    let raw_links = robot
        .all("link")
        .map(|link| parts::link(link, &mut findings))
        .collect::<Result<Vec<_>, _>>()?;
    let raw_joints = robot
        .all("joint")
        .map(|joint| parts::joint(joint, &mut findings))
        .collect::<Result<Vec<_>, _>>()?;
    let places = tree::walk(&raw_links, &raw_joints)?;
    let followers = mimic::followers(&raw_joints)?;

    // Independent joints are numbered in the order of the walk, before any joint that follows one.
    let mut number_of_joint: Vec<Option<usize>> = vec![None; raw_joints.len()];
    let mut joints = Vec::new();
    for (idx, place) in places.iter().enumerate() {
        let Some(joint) = place.joint else { continue };
        if let (Some(kind), None) = (raw_joints[joint].kind, followers[joint]) {
            number_of_joint[joint] = Some(joints.len());
            joints.push(independent(&raw_joints[joint], kind, idx));
        }
    }
    for (joint, follower) in raw_joints.iter().zip(&followers) {
        if let Some(follower) = follower
            && let Some(master) = number_of_joint[follower.master]
        {
            mimic::narrow(&mut joints[master], joint, *follower, &mut findings);
        }
    }
    let links = places
        .iter()
        .map(|place| {
            let raw = &raw_links[place.link];
            let mut link = Link {
                name: raw.name.clone(),
                joint_name: None,
                parent: place.parent,
                joint: None,
                kind: None,
                multiplier: 1.0,
                offset: 0.0,
                parent_from_joint: Pose::identity(),
                axis: Vector3::z_axis(),
                inertial: raw.inertial.clone(),
                collisions: raw.collisions.clone(),
                meshes: raw.meshes.clone(),
            };
            if let Some(joint) = place.joint {
                let raw = &raw_joints[joint];
                link.joint_name = Some(raw.name.clone());
                link.kind = raw.kind;
                link.parent_from_joint = raw.parent_from_joint;
                link.axis = raw.axis;
                if let Some(number) = number_of_joint[joint] {
                    link.joint = Some(number);
                    link.kind = Some(joints[number].kind);
                }
                if let Some(follower) = followers[joint] {
                    link.joint = number_of_joint[follower.master];
                    link.multiplier = follower.multiplier;
                    link.offset = follower.offset;
                }
            }
            link
        })
        .collect();
    Ok(RobotModel {
        name: robot.attribute("name").unwrap_or_default().to_owned(),
        links,
        joints,
        findings,
        has_mesh_shapes: false,
    })
}

/// Returns a joint that follows no other and moves the link of this place.
fn independent(joint: &RawJoint, kind: JointKind, link: usize) -> Joint {
    let (lower, upper) = joint.range;
    Joint {
        name: joint.name.clone(),
        kind,
        link,
        lower,
        upper,
        effort: joint.effort,
        velocity: joint.velocity,
    }
}
