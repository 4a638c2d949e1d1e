//! Links and joints as `urdf-rs` has read them, before they are a tree: in our types, and checked.

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use spatial::Pose;
use urdf_rs::{Geometry, JointType};

use crate::{Collision, Inertial, JointKind, Link, Mesh, RobotError, Shape};

/// Shortest axis that still has a direction.
const MIN_AXIS_LENGTH: f64 = 1e-6;

/// Returns a link that hangs on nothing.
pub(super) fn link(read: &urdf_rs::Link) -> Result<Link, RobotError> {
    let drawn = |geometry: &Geometry, origin, is_collision| match geometry {
        Geometry::Mesh { filename, scale } => Some(Mesh {
            file: filename.clone(),
            is_collision,
            link_from_mesh: pose(origin),
            scale: scale.map_or(Vector3::repeat(1.0), |scale| scale.0.into()),
        }),
        _ => None,
    };
    let colliding = read.collision.iter();
    let colliding = colliding.filter_map(|part| drawn(&part.geometry, &part.origin, true));
    let seen = read.visual.iter();
    let seen = seen.filter_map(|part| drawn(&part.geometry, &part.origin, false));
    let shapes = read.collision.iter().filter_map(|part| {
        Some(Collision {
            link_from_shape: pose(&part.origin),
            shape: shape(&part.geometry)?,
        })
    });
    Ok(Link {
        name: read.name.clone(),
        joint_name: None,
        parent: None,
        joint: None,
        kind: None,
        multiplier: 1.0,
        offset: 0.0,
        parent_from_joint: Pose::identity(),
        axis: Vector3::z_axis(),
        inertial: inertial(read)?,
        meshes: colliding.chain(seen).collect(),
        collisions: shapes.collect(),
    })
}

/// Returns a link's mass properties; `None` if it weighs nothing.
fn inertial(link: &urdf_rs::Link) -> Result<Option<Inertial>, RobotError> {
    let mass_kg = link.inertial.mass.value;
    if mass_kg < 0.0 {
        return Err(RobotError::NegativeMass {
            link: link.name.clone(),
            mass_kg,
        });
    }
    if mass_kg == 0.0 {
        return Ok(None);
    }
    #[rustfmt::skip]
    let &urdf_rs::Inertia { ixx, ixy, ixz, iyy, iyz, izz } = &link.inertial.inertia;
    let inertia = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let link_from_inertial: Pose<Link, Inertial> = pose(&link.inertial.origin);
    let rotation = link_from_inertial.rotation.to_rotation_matrix();
    Ok(Some(Inertial {
        mass_kg,
        center_of_mass_m: Point3::from(link_from_inertial.translation.vector),
        inertia_kg_m2: rotation.matrix() * inertia * rotation.matrix().transpose(),
    }))
}

/// Returns a shape about its center; `None` for a mesh.
fn shape(geometry: &Geometry) -> Option<Shape> {
    Some(match *geometry {
        Geometry::Box { size } => Shape::Box {
            half_extents_m: Vector3::from(size.0) / 2.0,
        },
        Geometry::Sphere { radius } => Shape::Sphere { radius_m: radius },
        Geometry::Cylinder { radius, length } => Shape::Cylinder {
            radius_m: radius,
            half_length_m: length / 2.0,
        },
        Geometry::Capsule { radius, length } => Shape::Capsule {
            radius_m: radius,
            half_length_m: length / 2.0,
        },
        Geometry::Mesh { .. } => return None,
    })
}

/// Returns the pose of an `<origin>`: roll about x, then pitch about y, then yaw about z, all fixed axes.
pub(super) fn pose<To, From>(origin: &urdf_rs::Pose) -> Pose<To, From> {
    let [roll, pitch, yaw] = origin.rpy.0;
    let rotation = nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Pose::from_parts(origin.xyz.0, rotation)
}

/// Returns the kind of a joint's motion; `None` if it cannot move.
pub(super) fn kind(joint: &urdf_rs::Joint) -> Option<JointKind> {
    match joint.joint_type {
        JointType::Revolute => Some(JointKind::Revolute),
        JointType::Continuous => Some(JointKind::Continuous),
        JointType::Prismatic => Some(JointKind::Prismatic),
        JointType::Fixed => None,
        JointType::Floating | JointType::Planar | JointType::Spherical => {
            unreachable!("joints of these types are refused before")
        }
    }
}

/// Returns a joint's least and greatest position; infinite if there is none.
pub(super) fn range(joint: &urdf_rs::Joint) -> (f64, f64) {
    match kind(joint) {
        Some(JointKind::Revolute | JointKind::Prismatic) => (joint.limit.lower, joint.limit.upper),
        Some(JointKind::Continuous) | None => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

/// Returns a joint's axis, having checked its limits.
pub(super) fn axis(joint: &urdf_rs::Joint) -> Result<Unit<Vector3<f64>>, RobotError> {
    let (lower, upper) = range(joint);
    if lower > upper {
        return Err(RobotError::BadLimits {
            joint: joint.name.clone(),
            lower,
            upper,
        });
    }
    Unit::try_new(joint.axis.xyz.0.into(), MIN_AXIS_LENGTH).ok_or_else(|| RobotError::ZeroAxis {
        joint: joint.name.clone(),
    })
}
