//! The hand's links as the engine's bodies, joints and shapes.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rapier3d::{
    math::{Pose, Rotation},
    prelude::{
        GenericJoint, GenericJointBuilder, JointAxesMask, MassProperties, SharedShape, Vector,
    },
};
use robot::{JointKind, Link, RobotModel, Shape};

use crate::{
    error::SimulationError,
    object::principal_moments,
    precision::{matrix, point, pose, real, rotation, vector},
};

/// Links that do not move relative to each other: one body of the engine.
pub(crate) struct RigidGroup {
    /// The link that moves, whose frame is the body's.
    pub(crate) root: usize,
    /// All links and their poses in the body's frame.
    pub(crate) links: Vec<(usize, Isometry3<f64>)>,
}

/// Merges links with those to which they are fixed; parents before children.
pub(crate) fn rigid_groups(model: &RobotModel) -> Vec<RigidGroup> {
    let mut groups: Vec<RigidGroup> = Vec::new();
    let mut group_of_link = Vec::with_capacity(model.links().len());
    for (idx, link) in model.links().iter().enumerate() {
        let group = if let (None, Some(parent)) = (link.kind, link.parent) {
            let group: usize = group_of_link[parent];
            let body_from_parent = groups[group]
                .links
                .iter()
                .find(|(member, _)| *member == parent)
                .map_or_else(Isometry3::identity, |(_, pose)| *pose);
            groups[group]
                .links
                .push((idx, body_from_parent * link.parent_from_joint));
            group
        } else {
            groups.push(RigidGroup {
                root: idx,
                links: vec![(idx, Isometry3::identity())],
            });
            groups.len() - 1
        };
        group_of_link.push(group);
    }
    groups
}

/// Adds up the mass properties of a body's links, each times `scale`; refuses a body that has none.
pub(crate) fn mass_properties(
    model: &RobotModel,
    group: &RigidGroup,
    scale: f64,
) -> Result<MassProperties, SimulationError> {
    let no_inertia = || SimulationError::NoInertia {
        link: model.links()[group.root].name.clone(),
    };
    let parts: Vec<_> = group
        .links
        .iter()
        .filter_map(|(link, body_from_link)| {
            let inertial = model.links()[*link].inertial.as_ref()?;
            let axes = body_from_link.rotation.to_rotation_matrix();
            Some((
                inertial.mass_kg * scale,
                body_from_link * inertial.center_of_mass_m,
                axes * inertial.inertia_kg_m2 * axes.inverse() * scale,
            ))
        })
        .collect();
    let mass_kg: f64 = parts.iter().map(|(mass, ..)| mass).sum();
    if !(mass_kg.is_finite() && mass_kg > 0.0) {
        return Err(no_inertia());
    }
    let moment: Vector3<f64> = parts.iter().map(|(mass, com, _)| com.coords * *mass).sum();
    let center = moment / mass_kg;
    let inertia = parts
        .iter()
        .fold(Matrix3::zeros(), |sum, (mass, com, inertia)| {
            let arm = com.coords - center;
            // Steiner's theorem.
            sum + inertia
                + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * *mass
        });
    if !principal_moments(&inertia)
        .iter()
        .all(|moment| moment.is_finite() && *moment > 0.0)
    {
        return Err(no_inertia());
    }
    Ok(MassProperties::with_inertia_matrix(
        point(&center.into()),
        real(mass_kg),
        matrix(&inertia),
    ))
}

/// Returns a joint about (or along) the engine's x axis, turned onto the link's axis.
pub(crate) fn engine_joint(link: &Link, body_from_parent: &Isometry3<f64>) -> GenericJoint {
    let turn = Rotation3::rotation_between(&Vector3::x(), &link.axis)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    let turn = UnitQuaternion::from_rotation_matrix(&turn);
    let locked = match link.kind {
        Some(JointKind::Prismatic) => JointAxesMask::LOCKED_PRISMATIC_AXES,
        Some(JointKind::Revolute | JointKind::Continuous) => JointAxesMask::LOCKED_REVOLUTE_AXES,
        None => JointAxesMask::LOCKED_FIXED_AXES,
    };
    GenericJointBuilder::new(locked)
        .local_frame1(pose(&(body_from_parent * link.parent_from_joint * turn)))
        .local_frame2(Pose::from_rotation(rotation(&turn)))
        .build()
}

/// Returns the engine's shape and its pose in ours: the engine's cylinders stand along y.
pub(crate) fn engine_shape(shape: &Shape) -> (SharedShape, Pose) {
    match shape {
        Shape::Box { half_extents_m } => {
            let half = vector(half_extents_m);
            (SharedShape::cuboid(half.x, half.y, half.z), Pose::IDENTITY)
        }
        Shape::Sphere { radius_m } => (SharedShape::ball(real(*radius_m)), Pose::IDENTITY),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => (
            SharedShape::cylinder(real(*half_length_m), real(*radius_m)),
            Pose::from_rotation(Rotation::from_rotation_arc(Vector::Y, Vector::Z)),
        ),
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => (
            SharedShape::capsule_z(real(*half_length_m), real(*radius_m)),
            Pose::IDENTITY,
        ),
    }
}
