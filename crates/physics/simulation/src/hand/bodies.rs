//! The hand's links as the engine's bodies, joints and shapes.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rapier3d::{
    math::{Pose as EnginePose, Rotation},
    prelude::{
        GenericJoint, GenericJointBuilder, JointAxesMask, MassProperties, SharedShape, Vector,
    },
};
use robot::{HandShape, JointKind, Link, RobotModel, Shape};
use spatial::Pose;

use crate::{
    config::SceneConfig,
    error::SimulationError,
    object::principal_moments,
    units::{engine_pose, length, lengths, mass, matrix, point, rotation},
};

/// The frame of a body of the engine: that of the first of its links.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Body {}

/// The frame of an engine's joint: x along the link's axis.
enum Axis {}

/// Links that do not move relative to each other: one body of the engine.
pub(crate) struct RigidGroup {
    /// The link that moves, whose frame is the body's.
    pub(crate) root: usize,
    /// All links and their poses in the body's frame.
    pub(crate) links: Vec<(usize, Pose<Body, Link>)>,
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
                .map_or_else(Pose::identity, |(_, pose)| *pose);
            groups[group]
                .links
                .push((idx, body_from_parent * link.parent_from_joint));
            group
        } else {
            groups.push(RigidGroup {
                root: idx,
                links: vec![(idx, Pose::identity())],
            });
            groups.len() - 1
        };
        group_of_link.push(group);
    }
    groups
}

/// Adds up the mass properties of a body's links, each times `scale`; refuses a moving body that has
/// none.
///
/// A root without any has those of the whole hand with its joints at 0: it yields to nothing, and
/// with any values the equations of the links that it carries can be solved.
pub(crate) fn mass_properties(
    model: &RobotModel,
    group: &RigidGroup,
    scale: f64,
) -> Result<MassProperties, SimulationError> {
    if let Some(own) = summed(model, &group.links, scale) {
        return Ok(own);
    }
    let lacking = |links: Vec<usize>| SimulationError::NoInertia {
        links: links
            .into_iter()
            .map(|link| model.links()[link].name.clone())
            .collect(),
    };
    if group.root != 0 {
        let all = model.bodies_without_inertia();
        let named = all.contains(&group.root);
        return Err(lacking(if named { all } else { vec![group.root] }));
    }
    let all = model.link_poses(|_| 0.0).into_iter().enumerate();
    let all: Vec<_> = all.collect();
    summed(model, &all, scale).ok_or_else(|| lacking(vec![0]))
}

/// Adds up the mass properties of links at their poses, each times `scale`; `None` if there are none.
fn summed(
    model: &RobotModel,
    links: &[(usize, Pose<Body, Link>)],
    scale: f64,
) -> Option<MassProperties> {
    let parts: Vec<_> = links
        .iter()
        .filter_map(|(link, body_from_link)| {
            let inertial = model.links()[*link].inertial.as_ref()?;
            let axes = body_from_link.rotation.to_rotation_matrix();
            Some((
                inertial.mass_kg * scale,
                *body_from_link * inertial.center_of_mass_m,
                axes * inertial.inertia_kg_m2 * axes.inverse() * scale,
            ))
        })
        .collect();
    let mass_kg: f64 = parts.iter().map(|(mass, ..)| mass).sum();
    if !(mass_kg.is_finite() && mass_kg > 0.0) {
        return None;
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
    let is_physical = principal_moments(&inertia)
        .iter()
        .all(|moment| moment.is_finite() && *moment > 0.0);
    is_physical.then(|| {
        MassProperties::with_inertia_matrix(point(&center.into()), mass(mass_kg), matrix(&inertia))
    })
}

/// Returns a joint about (or along) the engine's x axis, turned onto the link's axis.
pub(crate) fn engine_joint(link: &Link, body_from_parent: &Pose<Body, Link>) -> GenericJoint {
    let turn = Rotation3::rotation_between(&Vector3::x(), &link.axis)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    let turn = UnitQuaternion::from_rotation_matrix(&turn);
    let body_from_joint = *body_from_parent * link.parent_from_joint;
    let body_from_axis = Pose::<Body, Axis>::new(*body_from_joint * turn);
    let locked = match link.kind {
        Some(JointKind::Prismatic) => JointAxesMask::LOCKED_PRISMATIC_AXES,
        Some(JointKind::Revolute | JointKind::Continuous) => JointAxesMask::LOCKED_REVOLUTE_AXES,
        None => JointAxesMask::LOCKED_FIXED_AXES,
    };
    GenericJointBuilder::new(locked)
        .local_frame1(engine_pose(&body_from_axis))
        .local_frame2(EnginePose::from_rotation(rotation(&turn)))
        .build()
}

/// A link's collision shape as the engine has it.
#[derive(Debug, Clone)]
pub(crate) struct LinkShape {
    /// Its link and finger, and what it touches.
    pub(crate) of_hand: HandShape,
    /// The shape about its center as the model has it.
    pub(crate) shape: Shape,
    /// Pose of that center in the link's frame.
    pub(crate) link_from_shape: Pose<Link, Shape>,
    /// The engine's shape.
    pub(crate) engine: SharedShape,
    /// Pose of the engine's shape in ours.
    pub(crate) shape_from_engine: EnginePose,
}

/// Checks that a hand can be simulated in a scene, whatever the object.
///
/// # Errors
///
/// Fails if a moving part of the hand has no inertia, if it has no shape or a mesh that was not loaded.
pub(crate) fn check(model: &RobotModel, scene: &SceneConfig) -> Result<(), SimulationError> {
    link_shapes(model)?;
    for group in rigid_groups(model) {
        mass_properties(model, &group, scene.hand_mass_scale)?;
    }
    Ok(())
}

/// Returns every collision shape of the hand, link after link.
///
/// # Errors
///
/// Fails if there is none, if the shapes of the meshes that a link collides with are not there, and if
/// one is too small or flat for the engine.
pub(crate) fn link_shapes(model: &RobotModel) -> Result<Vec<LinkShape>, SimulationError> {
    if let Some((link, mesh)) = model.without_mesh_shape() {
        return Err(SimulationError::MeshNotRead {
            link: link.name.clone(),
            file: mesh.file.clone(),
        });
    }
    let mut shapes = Vec::new();
    let links = model.links().iter();
    let collisions = links.flat_map(|link| link.collisions.iter().map(move |one| (link, one)));
    for ((link, collision), of_hand) in collisions.zip(model.hand_shapes()) {
        let (engine, shape_from_engine) =
            engine_shape(&collision.shape).ok_or_else(|| SimulationError::FlatLink {
                link: link.name.clone(),
            })?;
        shapes.push(LinkShape {
            of_hand,
            shape: collision.shape.clone(),
            link_from_shape: collision.link_from_shape,
            engine,
            shape_from_engine,
        });
    }
    if shapes.is_empty() {
        return Err(SimulationError::NoCollisions);
    }
    Ok(shapes)
}

/// Returns the engine's shape and its pose in ours: the engine's cylinders stand along y. `None` if a
/// body has no volume in single precision.
fn engine_shape(shape: &Shape) -> Option<(SharedShape, EnginePose)> {
    Some(match shape {
        Shape::Box { half_extents_m } => {
            let half = lengths(half_extents_m);
            (
                SharedShape::cuboid(half.x, half.y, half.z),
                EnginePose::IDENTITY,
            )
        }
        Shape::Sphere { radius_m } => (SharedShape::ball(length(*radius_m)), EnginePose::IDENTITY),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => (
            SharedShape::cylinder(length(*half_length_m), length(*radius_m)),
            EnginePose::from_rotation(Rotation::from_rotation_arc(Vector::Y, Vector::Z)),
        ),
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => (
            SharedShape::capsule_z(length(*half_length_m), length(*radius_m)),
            EnginePose::IDENTITY,
        ),
        Shape::Convex(body) => {
            let corners: Vec<Vector> = body.corners_m().iter().map(point).collect();
            (SharedShape::convex_hull(&corners)?, EnginePose::IDENTITY)
        }
    })
}
