//! From the text of a URDF to a tree of links: `urdf-rs` reads it between what it needs before and what it
//! leaves open.

mod mimic;
mod parts;
mod repair;
mod tree;
mod xml;

pub use self::xml::MAX_BYTES;

use std::sync::{Mutex, PoisonError};

use crate::{Joint, JointKind, RobotError, RobotModel};

/// Number of robots that are kept as they were read: the stages of a pipeline read the same few.
const KEPT: usize = 4;

/// The robots that were read last, the newest first, by their text: reading one takes a millisecond or more.
static READ: Mutex<Vec<(Box<str>, RobotModel)>> = Mutex::new(Vec::new());

/// Maximum number of links that are read, a hundred times those of a hand with an arm.
const MAX_LINKS: usize = 5000;

/// Returns the encoding of a document's bytes, as `iconv` names it: that of its byte order mark, or else the
/// one that its first line declares (Bray et al., *Extensible Markup Language 1.0*, 2008, appendix F).
pub(crate) fn encoding(bytes: &[u8]) -> String {
    if bytes.starts_with(&[0xff, 0xfe])
        || bytes.starts_with(&[0xfe, 0xff])
        || bytes.iter().take(4).any(|&byte| byte == 0)
    {
        return "UTF-16".to_owned();
    }
    let head = String::from_utf8_lossy(bytes.get(..200).unwrap_or(bytes));
    let declaration = head.split_once("?>").map_or("", |(before, _)| before);
    let value = declaration
        .split_once("encoding")
        .map_or("", |(_, after)| after);
    let value = value.trim_start_matches(|c: char| c == '=' || c.is_whitespace());
    let name = value.split(['"', '\'']).nth(1).unwrap_or_default();
    let is_name = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    match name {
        // What it declares is not so.
        "" => "ISO-8859-1".to_owned(),
        name if name.eq_ignore_ascii_case("utf-8") || !name.chars().all(is_name) => {
            "ISO-8859-1".to_owned()
        }
        name => name.to_owned(),
    }
}

/// Returns the robot of a URDF's text, which is read if it is none of the last ones.
pub(crate) fn parse(text: &str) -> Result<RobotModel, RobotError> {
    let read = || READ.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, robot)) = read().iter().find(|(known, _)| **known == *text) {
        return Ok(robot.clone());
    }
    let robot = read_robot(text, Mimics::Follow)?;
    let mut kept = read();
    kept.truncate(KEPT - 1);
    kept.insert(0, (text.into(), robot.clone()));
    Ok(robot)
}

/// Treatment of joints that mimic others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mimics {
    /// They follow the others.
    Follow,
    /// They are independent, as if the URDF did not say so.
    Independent,
}

/// Reads a robot from the text of its URDF.
pub(crate) fn read_robot(text: &str, mimics: Mimics) -> Result<RobotModel, RobotError> {
    let robot = xml::read(text)?;
    if robot.all("link").count() > MAX_LINKS || robot.all("joint").count() > MAX_LINKS {
        return Err(RobotError::TooLarge {
            what: "links or joints",
            limit: MAX_LINKS,
        });
    }
    let mut findings = Vec::new();
    let repaired = repair::repaired(&robot, &mut findings)?;
    let mut robot =
        urdf_rs::read_from_string(&repaired.to_string()).map_err(|source| RobotError::Refused {
            source: Box::new(source),
        })?;
    if mimics == Mimics::Independent {
        for joint in &mut robot.joints {
            joint.mimic = None;
        }
    }
    let lone_links: Vec<_> = robot
        .links
        .iter()
        .map(parts::link)
        .collect::<Result<_, _>>()?;
    let axes: Vec<_> = robot
        .joints
        .iter()
        .map(parts::axis)
        .collect::<Result<_, _>>()?;
    let places = tree::walk(&robot.links, &robot.joints)?;
    let followers = mimic::followers(&robot.joints)?;

    // Before any joint that follows one of them.
    let (number_of_joint, mut joints) = numbered(&robot.joints, &places, &followers);
    for (joint, follower) in robot.joints.iter().zip(&followers) {
        if let Some(follower) = follower
            && let Some(master) = number_of_joint[follower.master]
        {
            mimic::narrow(&mut joints[master], joint, *follower, &mut findings);
        }
    }
    let links = places
        .iter()
        .map(|place| {
            let mut link = lone_links[place.link].clone();
            link.parent = place.parent;
            if let Some(joint) = place.joint {
                let hangs_on = &robot.joints[joint];
                link.joint_name = Some(hangs_on.name.clone());
                link.kind = parts::kind(hangs_on);
                link.parent_from_joint = parts::pose(&hangs_on.origin);
                link.axis = axes[joint];
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
        name: robot.name,
        links,
        joints,
        findings,
        has_mesh_shapes: false,
    })
}

/// Returns the independent joints, in the order of the walk, and the number of each joint that is one of them.
fn numbered(
    of_robot: &[urdf_rs::Joint],
    places: &[tree::TreePosition],
    followers: &[Option<mimic::Follower>],
) -> (Vec<Option<usize>>, Vec<Joint>) {
    let mut number_of_joint: Vec<Option<usize>> = vec![None; of_robot.len()];
    let mut joints = Vec::new();
    for (idx, place) in places.iter().enumerate() {
        let Some(joint) = place.joint else { continue };
        if let (Some(kind), None) = (parts::kind(&of_robot[joint]), followers[joint]) {
            number_of_joint[joint] = Some(joints.len());
            joints.push(independent(&of_robot[joint], kind, idx));
        }
    }
    (number_of_joint, joints)
}

/// Returns a joint that follows no other and moves the link of this place.
fn independent(joint: &urdf_rs::Joint, kind: JointKind, link: usize) -> Joint {
    let (lower, upper) = parts::range(joint);
    Joint {
        name: joint.name.clone(),
        kind,
        link,
        lower,
        upper,
        effort: joint.limit.effort,
        velocity: joint.limit.velocity,
    }
}
