//! From the text of a URDF to a tree of links.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType};

use crate::{
    Collision, Inertial, Joint, JointKind, Link, RobotError, RobotModel, Shape, near::near_names,
};

/// Shortest axis that still has a direction.
const MIN_AXIS_LENGTH: f64 = 1e-6;

/// Reads a robot from the text of its URDF.
pub(crate) fn parse(xml: &str) -> Result<RobotModel, RobotError> {
    let robot = urdf_rs::read_from_string(xml).map_err(|source| RobotError::NotUrdf { source })?;
    check_names("link", robot.links.iter().map(|link| link.name.as_str()))?;
    check_names(
        "joint",
        robot.joints.iter().map(|joint| joint.name.as_str()),
    )?;
    let order = walk(&robot)?;
    let mut link_idx: BTreeMap<&str, usize> = BTreeMap::new();
    let mut links = Vec::with_capacity(order.len());
    let mut joints: Vec<Joint> = Vec::new();
    // Which joint moves a link follows only once every independent joint has its number.
    for (link, parent_joint) in &order {
        let idx = links.len();
        link_idx.insert(&link.name, idx);
        let (mut parent, mut kind, mut axis, mut own_joint) = (None, None, Vector3::z_axis(), None);
        let mut parent_from_joint = Isometry3::identity();
        if let Some(joint) = parent_joint {
            parent = link_idx.get(joint.parent.link.as_str()).copied();
            parent_from_joint = pose(&joint.origin, &joint.name)?;
            kind = joint_kind(joint)?;
            if let Some(kind) = kind {
                axis = joint_axis(joint)?;
                if joint.mimic.is_none() {
                    own_joint = Some(joints.len());
                    joints.push(independent_joint(joint, kind, idx)?);
                }
            }
        }
        links.push(Link {
            name: link.name.clone(),
            joint_name: parent_joint.map(|joint| joint.name.clone()),
            parent,
            joint: own_joint,
            kind,
            multiplier: 1.0,
            offset: 0.0,
            parent_from_joint,
            axis,
            inertial: inertial(link)?,
            collisions: collisions(link)?,
        });
    }
    for (link, (_, parent_joint)) in links.iter_mut().zip(&order) {
        if let (Some(_), Some(joint)) = (link.kind, parent_joint)
            && joint.mimic.is_some()
        {
            let (master, multiplier, offset) = follow_mimic(&robot, joint)?;
            link.joint = joints
                .iter()
                .position(|candidate| candidate.name == master.name);
            link.multiplier = multiplier;
            link.offset = offset;
            if link.joint.is_none() {
                return Err(RobotError::BadMimic {
                    joint: joint.name.clone(),
                    master: master.name.clone(),
                });
            }
        }
    }
    Ok(RobotModel {
        name: robot.name.clone(),
        links,
        joints,
    })
}

fn check_names<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a str>,
) -> Result<(), RobotError> {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    match names
        .windows(2)
        .find_map(|pair| (pair.first() == pair.last()).then(|| pair.first())?)
    {
        Some(name) => Err(RobotError::Duplicate {
            what,
            name: (*name).to_owned(),
        }),
        None => Ok(()),
    }
}

/// A link and the joint it hangs on.
type LinkAndJoint<'a> = (&'a urdf_rs::Link, Option<&'a urdf_rs::Joint>);

/// Returns every link with the joint it hangs on, depth first, in the order of the file.
fn walk(robot: &urdf_rs::Robot) -> Result<Vec<LinkAndJoint<'_>>, RobotError> {
    let links: BTreeMap<&str, &urdf_rs::Link> = robot
        .links
        .iter()
        .map(|link| (link.name.as_str(), link))
        .collect();
    let mut parent_joints: BTreeMap<&str, &urdf_rs::Joint> = BTreeMap::new();
    let mut children: BTreeMap<&str, Vec<&urdf_rs::Joint>> = BTreeMap::new();
    for joint in &robot.joints {
        for (role, name) in [("parent", &joint.parent.link), ("child", &joint.child.link)] {
            if !links.contains_key(name.as_str()) {
                return Err(RobotError::UnknownLink {
                    joint: joint.name.clone(),
                    role,
                    link: name.clone(),
                    near: near_names(name, links.keys().copied()),
                });
            }
        }
        if let Some(first) = parent_joints.insert(&joint.child.link, joint) {
            return Err(RobotError::TwoParents {
                link: joint.child.link.clone(),
                first: first.name.clone(),
                second: joint.name.clone(),
            });
        }
        children.entry(&joint.parent.link).or_default().push(joint);
    }
    let mut orphans = robot
        .links
        .iter()
        .filter(|link| !parent_joints.contains_key(link.name.as_str()));
    let first_link = robot.links.first().ok_or(RobotError::NoLink)?;
    let top = orphans.next().ok_or_else(|| RobotError::Loop {
        link: first_link.name.clone(),
    })?;
    if let Some(second) = orphans.next() {
        return Err(RobotError::TwoRoots {
            first: top.name.clone(),
            second: second.name.clone(),
        });
    }
    let mut order = Vec::with_capacity(links.len());
    let mut stack: Vec<LinkAndJoint<'_>> = vec![(top, None)];
    while let Some((link, joint)) = stack.pop() {
        order.push((link, joint));
        for child_joint in children.get(link.name.as_str()).into_iter().flatten().rev() {
            if let Some(child) = links.get(child_joint.child.link.as_str()) {
                stack.push((child, Some(child_joint)));
            }
        }
    }
    // Each link has at most one parent, so what the walk misses hangs on a loop.
    let missed = robot
        .links
        .iter()
        .find(|link| !order.iter().any(|(reached, _)| reached.name == link.name));
    match missed {
        Some(link) => Err(RobotError::Loop {
            link: link.name.clone(),
        }),
        None => Ok(order),
    }
}

/// Returns how a joint moves, `None` if it does not.
fn joint_kind(joint: &urdf_rs::Joint) -> Result<Option<JointKind>, RobotError> {
    let unsupported = |kind| {
        Err(RobotError::UnsupportedJoint {
            joint: joint.name.clone(),
            kind,
        })
    };
    match joint.joint_type {
        JointType::Revolute => Ok(Some(JointKind::Revolute)),
        JointType::Continuous => Ok(Some(JointKind::Continuous)),
        JointType::Prismatic => Ok(Some(JointKind::Prismatic)),
        JointType::Fixed => Ok(None),
        JointType::Floating => unsupported("floating"),
        JointType::Planar => unsupported("planar"),
        JointType::Spherical => unsupported("spherical"),
    }
}

fn independent_joint(
    joint: &urdf_rs::Joint,
    kind: JointKind,
    link: usize,
) -> Result<Joint, RobotError> {
    let limit = &joint.limit;
    let (lower, upper) = match kind {
        JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        JointKind::Revolute | JointKind::Prismatic => (limit.lower, limit.upper),
    };
    let usable =
        kind == JointKind::Continuous || (lower.is_finite() && upper.is_finite() && lower < upper);
    if !usable {
        return Err(RobotError::BadLimits {
            joint: joint.name.clone(),
            lower,
            upper,
        });
    }
    for (what, number) in [
        ("the effort limit", limit.effort),
        ("the velocity limit", limit.velocity),
    ] {
        if number.is_nan() || number < 0.0 {
            return Err(RobotError::BadNumber {
                what,
                name: joint.name.clone(),
            });
        }
    }
    Ok(Joint {
        name: joint.name.clone(),
        kind,
        link,
        lower,
        upper,
        effort: limit.effort,
        velocity: limit.velocity,
    })
}

fn joint_axis(joint: &urdf_rs::Joint) -> Result<Unit<Vector3<f64>>, RobotError> {
    Unit::try_new(Vector3::from(*joint.axis.xyz), MIN_AXIS_LENGTH)
        .filter(|axis| axis.iter().all(|number| number.is_finite()))
        .ok_or_else(|| RobotError::ZeroAxis {
            joint: joint.name.clone(),
        })
}

/// Returns the independent joint that a mimic joint follows in the end, with the multiplier and
/// the offset of its own position.
fn follow_mimic<'a>(
    robot: &'a urdf_rs::Robot,
    joint: &'a urdf_rs::Joint,
) -> Result<(&'a urdf_rs::Joint, f64, f64), RobotError> {
    let (mut current, mut multiplier, mut offset) = (joint, 1.0, 0.0);
    // One turn per joint at most: more would be a loop.
    for _ in 0..=robot.joints.len() {
        let Some(mimic) = &current.mimic else {
            return Ok((current, multiplier, offset));
        };
        offset += multiplier * mimic.offset.unwrap_or(0.0);
        multiplier *= mimic.multiplier.unwrap_or(1.0);
        let master = robot
            .joints
            .iter()
            .find(|candidate| candidate.name == mimic.joint);
        match master {
            Some(master) if multiplier.is_finite() && offset.is_finite() => current = master,
            Some(_) | None => break,
        }
    }
    Err(RobotError::BadMimic {
        joint: joint.name.clone(),
        master: joint
            .mimic
            .as_ref()
            .map(|mimic| mimic.joint.clone())
            .unwrap_or_default(),
    })
}

/// Reads an `<origin>`: roll about x, then pitch about y, then yaw about z, all fixed axes.
fn pose(origin: &urdf_rs::Pose, name: &str) -> Result<Isometry3<f64>, RobotError> {
    let [x, y, z] = *origin.xyz;
    let [roll, pitch, yaw] = *origin.rpy;
    if ![x, y, z, roll, pitch, yaw]
        .iter()
        .all(|number| number.is_finite())
    {
        return Err(RobotError::BadNumber {
            what: "an origin",
            name: name.to_owned(),
        });
    }
    Ok(Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}

/// Reads a link's mass properties; the parser gives zeros where the file has none.
fn inertial(link: &urdf_rs::Link) -> Result<Option<Inertial>, RobotError> {
    let mass_kg = link.inertial.mass.value;
    let i = &link.inertial.inertia;
    let numbers = [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz];
    if !mass_kg.is_finite() || mass_kg < 0.0 || !numbers.iter().all(|number| number.is_finite()) {
        return Err(RobotError::BadNumber {
            what: "the inertial",
            name: link.name.clone(),
        });
    }
    if mass_kg == 0.0 {
        return Ok(None);
    }
    let link_from_inertial = pose(&link.inertial.origin, &link.name)?;
    let inertia = Matrix3::new(
        i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz,
    );
    let rotation = link_from_inertial.rotation.to_rotation_matrix();
    Ok(Some(Inertial {
        mass_kg,
        center_of_mass_m: Point3::from(link_from_inertial.translation.vector),
        inertia_kg_m2: rotation.matrix() * inertia * rotation.matrix().transpose(),
    }))
}

/// Reads a link's collision primitives; meshes are left out and never opened.
fn collisions(link: &urdf_rs::Link) -> Result<Vec<Collision>, RobotError> {
    let mut collisions = Vec::with_capacity(link.collision.len());
    for collision in &link.collision {
        let shape = match &collision.geometry {
            Geometry::Box { size } => Shape::Box {
                half_extents_m: Vector3::from(**size) / 2.0,
            },
            Geometry::Sphere { radius } => Shape::Sphere { radius_m: *radius },
            Geometry::Cylinder { radius, length } => Shape::Cylinder {
                radius_m: *radius,
                half_length_m: length / 2.0,
            },
            Geometry::Capsule { radius, length } => Shape::Capsule {
                radius_m: *radius,
                half_length_m: length / 2.0,
            },
            Geometry::Mesh { .. } => continue,
        };
        if !has_volume(&shape) {
            return Err(RobotError::BadNumber {
                what: "a collision shape",
                name: link.name.clone(),
            });
        }
        collisions.push(Collision {
            link_from_shape: pose(&collision.origin, &link.name)?,
            shape,
        });
    }
    Ok(collisions)
}

fn has_volume(shape: &Shape) -> bool {
    let positive = |length: f64| length.is_finite() && length > 0.0;
    match shape {
        Shape::Box { half_extents_m } => half_extents_m.iter().all(|&half| positive(half)),
        Shape::Sphere { radius_m } => positive(*radius_m),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => positive(*radius_m) && positive(*half_length_m),
        // A capsule without a cylinder is a ball.
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => positive(*radius_m) && half_length_m.is_finite() && *half_length_m >= 0.0,
    }
}
