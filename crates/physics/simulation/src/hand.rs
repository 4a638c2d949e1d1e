//! The hand: a palm that follows its path and, on it, fingers that are driven.
//!
//! Forces on one finger reach no other through the palm: where this yields, it does so to the sum of their contacts
//! ([`crate::palm_compliance`]); fingers push each other where they touch. Each finger is a multibody of its own, whose
//! root has the palm's motion. Four systems of four equations cost a fraction of one of sixteen; and once the palm
//! stands still ([`HandBodies::halt`]), its six coordinates are none of theirs any more.

mod bodies;
#[cfg(test)]
mod closed_forms;
mod controller;
mod feedforward;

use rapier3d::{
    math::{Pose as EnginePose, Vector},
    prelude::{
        ColliderBuilder, GenericJoint, GenericJointBuilder, InteractionGroups, JointAxesMask,
        MassProperties, Multibody, MultibodyJointHandle, MultibodyJointSet, MultibodyLink,
        RigidBody, RigidBodyBuilder, RigidBodyHandle, RigidBodyType,
    },
};
use robot::{DynamicsModel, HandShape, JointKind, Link, RobotModel};
use spatial::{Palm, Pose, Table};

pub(crate) use self::bodies::{LinkShape, check, link_shapes};
use self::{
    bodies::{Body, RigidGroup, engine_joint, mass_properties, rigid_groups},
    controller::Controller,
};
use crate::{
    config::SceneConfig,
    error::SimulationError,
    units::{EngineFrame, LENGTH_UNITS_PER_M, engine_pose, length, meters, real},
    world::{World, groups},
};

/// Height in meters at which the hand waits until it is placed.
const PARKING_HEIGHT_M: f64 = 1.0;
/// Greatest speed of a joint in radians or meters per second, for turning ones four times that of the
/// fastest drives of hands: a contact in a direction in which a finger hardly moves would move its joints
/// at any speed.
const MAX_JOINT_SPEED: f32 = 30.0;
/// Coordinates of the palm: three along the axes, three about them.
const DIMENSIONS: usize = 6;

/// The hand's bodies in a world and its drives.
#[derive(Debug, Clone)]
pub(crate) struct HandBodies {
    /// The palm, then the movable links.
    bodies: Vec<RigidBodyHandle>,
    /// For each body, the link whose frame is its own.
    links: Vec<usize>,
    /// For each body, the first of its finger; the palm's own is 0.
    fingers: Vec<usize>,
    /// The root of each finger, where the palm is.
    roots: Vec<Root>,
    drives: Vec<Drive>,
    /// Index into `drives` of each independent joint.
    joints: Vec<usize>,
    /// The controller's model of masses and inertias.
    dynamics: DynamicsModel,
}

/// The root of a finger's multibody.
#[derive(Debug, Clone, Copy)]
struct Root {
    body: RigidBodyHandle,
    /// Lets it move in the world as commanded.
    joint: MultibodyJointHandle,
}

/// The drive of one movable link.
#[derive(Debug, Clone, Copy)]
struct Drive {
    /// The link's body.
    body: RigidBodyHandle,
    /// Its axis among the six of a joint.
    axis: usize,
    /// The independent joint that commands it.
    joint: usize,
    /// The engine's units of the coordinate in a radian or a meter.
    units: f64,
    /// From the joint's position in radians or meters to the engine's coordinate.
    multiplier: f32,
    offset: f32,
    controller: Controller,
}

impl Drive {
    /// Sets the drive's torque for the next physics step: towards a joint's command, plus the feedforward
    /// `ahead`.
    fn apply(&self, multibody: &mut Multibody, address: JointAddress, q_command: f64, ahead: f32) {
        let spring = self.controller.spring(
            self.multiplier * real(q_command) + self.offset,
            ahead,
            position(multibody, address.link, self.axis),
            multibody.generalized_velocity()[address.coordinate],
        );
        multibody.damping_mut()[address.coordinate] = spring.damping;
        if let Some(link) = multibody.link_mut(address.link) {
            link.joint
                .set_spring(self.axis, spring.stiffness, spring.rest);
        }
    }

    /// Returns position and velocity of the link's joint (rad or m, per second); NaN if the engine no longer
    /// has it.
    fn state(&self, world: &World) -> [f64; 2] {
        let found = finger(&world.multibodies, self.body);
        found.map_or([f64::NAN; 2], |(multibody, address)| {
            let position = position(multibody, address.link, self.axis);
            let velocity = multibody.generalized_velocity()[address.coordinate];
            [position, velocity].map(|of| f64::from(of) / self.units)
        })
    }
}

/// Joint that carries the palm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PalmJoint {
    /// It follows its path regardless of forces on it.
    Driven,
    /// None: the palm flies freely.
    #[cfg(test)]
    Free,
}

impl HandBodies {
    /// Puts the hand into the world, waiting high above the table with all joints at zero.
    pub(crate) fn insert(
        world: &mut World,
        scene: &SceneConfig,
        model: &RobotModel,
    ) -> Result<Self, SimulationError> {
        Self::insert_on(world, scene, model, PalmJoint::Driven)
    }

    fn insert_on(
        world: &mut World,
        scene: &SceneConfig,
        model: &RobotModel,
        palm: PalmJoint,
    ) -> Result<Self, SimulationError> {
        let shapes = link_shapes(model)?;
        let groups = rigid_groups(model);
        let mut bodies: Vec<RigidBodyHandle> = Vec::with_capacity(groups.len());
        let parents = parents(&groups, model);
        let fingers = fingers(&parents);
        let mut roots = Vec::new();
        let parking = EnginePose::translation(0.0, 0.0, length(PARKING_HEIGHT_M));
        for (idx, group) in groups.iter().enumerate() {
            let mass = mass_properties(model, group, scene.hand_mass_scale)?;
            let link = &model.links()[group.root];
            let parent = parents[idx];
            let body = world.bodies.insert(match (parent, palm) {
                (None, PalmJoint::Driven) => RigidBodyBuilder::kinematic_velocity_based()
                    .pose(parking)
                    .can_sleep(false),
                _ => movable(mass),
            });
            for collider in colliders(group, &shapes, scene) {
                let collider = collider.user_data(idx as u128);
                world
                    .colliders
                    .insert_with_parent(collider, body, &mut world.bodies);
            }
            match (parent, palm) {
                (None, PalmJoint::Driven) => {}
                #[cfg(test)]
                (None, PalmJoint::Free) => {
                    let anchor = world.bodies.insert(RigidBodyBuilder::fixed());
                    let free = free_joint(parking);
                    let joint = world.multibodies.insert(anchor, body, free, true);
                    roots.extend(joint.map(|joint| Root { body, joint }));
                }
                (Some((parent, parent_body_from_parent)), _) => {
                    let on = if parent == 0 && palm == PalmJoint::Driven {
                        let mass = mass_properties(model, &groups[0], scene.hand_mass_scale)?;
                        let (body, joint) = insert_finger_root(world, mass, parking);
                        roots.extend(joint.map(|joint| Root { body, joint }));
                        body
                    } else {
                        bodies[parent]
                    };
                    let joint = engine_joint(link, &parent_body_from_parent);
                    world.multibodies.insert(on, body, joint, true);
                }
            }
            bodies.push(body);
        }
        for body in &bodies {
            let body = &mut world.bodies[*body];
            body.recompute_mass_properties_from_colliders(&world.colliders);
        }
        let mut hand = Self {
            bodies,
            links: groups.iter().map(|group| group.root).collect(),
            fingers,
            roots,
            drives: Vec::new(),
            joints: Vec::new(),
            dynamics: DynamicsModel::new(model)
                .with_mass_scale(scene.hand_mass_scale)
                .with_armature(scene.drive.armature),
        };
        hand.configure(world, scene, model, &groups);
        Ok(hand)
    }

    /// Masses and inertias, as the hand's controllers know them.
    pub(crate) fn dynamics(&self) -> &DynamicsModel {
        &self.dynamics
    }

    /// The link of each body, by its place in the model.
    pub(crate) fn links(&self) -> &[usize] {
        &self.links
    }

    /// Sets damping, armature and drives once the multibodies know that their roots are fixed.
    fn configure(
        &mut self,
        world: &mut World,
        scene: &SceneConfig,
        model: &RobotModel,
        groups: &[RigidGroup],
    ) {
        for root in &self.roots {
            let Some((multibody, _)) = finger_mut(&mut world.multibodies, root.body) else {
                continue;
            };
            multibody.set_self_contacts_enabled(false);
            multibody.forward_kinematics(&world.bodies, true);
            multibody.update_rigid_bodies(&mut world.bodies, true);
            multibody.damping_mut().fill(0.0);
        }
        self.joints = vec![0; model.dof()];
        for (group, body) in groups.iter().zip(&self.bodies) {
            let link = &model.links()[group.root];
            let (Some(joint), Some(kind)) = (link.joint, link.kind) else {
                continue;
            };
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, *body) else {
                continue;
            };
            let limits = &model.joints()[joint];
            let (multiplier, offset) = (link.multiplier, link.offset);
            let ends = [limits.lower, limits.upper].map(|end| multiplier * end + offset);
            if limits.link == group.root {
                self.joints[joint] = self.drives.len();
            }
            let (axis, units) = match kind {
                JointKind::Revolute | JointKind::Continuous => (3, 1.0),
                JointKind::Prismatic => (0, LENGTH_UNITS_PER_M),
            };
            self.drives.push(Drive {
                body: *body,
                axis,
                joint,
                units,
                multiplier: real(multiplier * units),
                offset: real(offset * units),
                controller: Controller::new(scene, ends, units),
            });
            let [damping, armature] =
                [scene.drive.damping, scene.drive.armature].map(|of| real(of / units.powi(2)));
            multibody.damping_mut()[address.coordinate] = damping;
            multibody.armature_mut()[address.coordinate] = armature;
        }
        for drive in &mut self.drives {
            if let Some((multibody, address)) = finger_mut(&mut world.multibodies, drive.body) {
                let inverse = multibody.dof_inverse_inertia(&world.bodies);
                drive.controller.inverse_inertia = inverse[address.coordinate];
            }
        }
    }

    /// Puts the hand at a pose at once, at rest.
    pub(crate) fn place(&self, world: &mut World, table_from_palm: &Pose<Table, Palm>, q: &[f64]) {
        let target = engine_pose(table_from_palm);
        if let Some(palm) = self.palm_mut(world).filter(|palm| palm.is_kinematic()) {
            palm.set_position(target, true);
            palm.set_linvel(Vector::ZERO, true);
            palm.set_angvel(Vector::ZERO, true);
        }
        for root in &self.roots {
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, root.body) else {
                continue;
            };
            let mut displacement = vec![0.0; multibody.ndofs()];
            let now = multibody
                .link(address.link)
                .map(|root| *root.local_to_world());
            if let (Some(now), Some(part)) = (now, displacement.get_mut(..DIMENSIONS)) {
                part.copy_from_slice(&twist(&now, &target, 1.0));
            }
            for drive in &self.drives {
                let Some(link) = link_of(multibody, drive.body) else {
                    continue;
                };
                if let (Some(target), Some(q)) =
                    (displacement.get_mut(link.assembly_id()), q.get(drive.joint))
                {
                    let position = link.joint.coords()[drive.axis];
                    *target = drive.multiplier * real(*q) + drive.offset - position;
                }
            }
            multibody.apply_displacements(&displacement);
            multibody.generalized_velocity_mut().fill(0.0);
            multibody.forward_kinematics(&world.bodies, false);
            multibody.update_rigid_bodies(&mut world.bodies, true);
        }
    }

    /// Gives the palm the velocity with which it is at `table_from_palm` in `seconds`.
    pub(crate) fn move_palm(
        &self,
        world: &mut World,
        table_from_palm: &Pose<Table, Palm>,
        seconds: f64,
    ) {
        self.move_palm_in_engine(world, &engine_pose(table_from_palm), real(seconds));
    }

    /// As [`HandBodies::move_palm`], with a target in the engine's frame and units.
    pub(crate) fn move_palm_in_engine(&self, world: &mut World, target: &EnginePose, seconds: f32) {
        if let Some(palm) = self.palm_mut(world) {
            let [x, y, z, about_x, about_y, about_z] = twist(palm.position(), target, seconds);
            palm.set_linvel(Vector::new(x, y, z), true);
            palm.set_angvel(Vector::new(about_x, about_y, about_z), true);
        }
        for root in &self.roots {
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, root.body) else {
                continue;
            };
            let Some(root) = multibody.link(address.link) else {
                continue;
            };
            let velocity = twist(root.local_to_world(), target, seconds);
            let mut velocities = multibody.generalized_velocity_mut();
            for (number, coordinate) in velocity.into_iter().zip(velocities.iter_mut()) {
                *coordinate = number;
            }
        }
    }

    /// Stops the palm for good: from now on it cannot be moved.
    pub(crate) fn halt(&self, world: &mut World) {
        if let Some(palm) = self.palm_mut(world) {
            palm.set_linvel(Vector::ZERO, true);
            palm.set_angvel(Vector::ZERO, true);
        }
        for root in &self.roots {
            world.multibodies.remove(root.joint, true);
            if let Some(body) = world.bodies.get_mut(root.body) {
                body.set_body_type(RigidBodyType::Fixed, true);
                // The engine keeps a body that has become fixed among the moving ones, and would move the
                // finger once for its root and once for itself; it skips disabled bodies.
                body.set_enabled(false);
            }
        }
    }

    /// Keeps every joint at a speed that it can have.
    pub(crate) fn limit_speed(&self, world: &mut World) {
        for drive in &self.drives {
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, drive.body) else {
                continue;
            };
            if let Some(velocity) = multibody
                .generalized_velocity_mut()
                .get_mut(address.coordinate)
            {
                let most = MAX_JOINT_SPEED * real(drive.units);
                *velocity = velocity.clamp(-most, most);
            }
        }
    }

    fn palm_mut<'a>(&self, world: &'a mut World) -> Option<&'a mut RigidBody> {
        world.bodies.get_mut(*self.bodies.first()?)
    }

    /// Sets every finger's torque for the next physics step.
    pub(crate) fn drive(&self, world: &mut World, q_command: &[f64]) {
        for drive in &self.drives {
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, drive.body) else {
                continue;
            };
            drive.apply(multibody, address, q_command[drive.joint], 0.0);
        }
    }

    /// Returns the pose of the palm.
    pub(crate) fn table_from_palm(&self, world: &World) -> Pose<Table, Palm> {
        world.table_from_body(self.bodies[0])
    }

    /// Returns the pose of the palm in the engine's frame.
    pub(crate) fn engine_from_palm(&self, world: &World) -> Pose<EngineFrame, Palm> {
        world.engine_from_body(self.bodies[0])
    }

    /// Returns the joint positions in radians or meters; NaN for a joint that the engine no longer has.
    pub(crate) fn positions(&self, world: &World) -> Vec<f64> {
        let states = self.states(world);
        states.map(|[position, _]| position).collect()
    }

    /// Returns position and velocity of each joint; NaN for one that the engine no longer has.
    fn states<'a>(&'a self, world: &'a World) -> impl Iterator<Item = [f64; 2]> + 'a {
        let drives = self.joints.iter().map(|&drive| &self.drives[drive]);
        drives.map(|drive| drive.state(world))
    }

    /// Returns the torque or force of each joint's drive (without end stops) in newton meters or newtons, as
    /// it was in the last physics step.
    #[cfg(test)]
    pub(crate) fn torques(&self, world: &World) -> Vec<f64> {
        self.joints
            .iter()
            .filter_map(|&drive| {
                let drive = self.drives.get(drive)?;
                let (multibody, address) = finger(&world.multibodies, drive.body)?;
                let (stiffness, rest) = multibody.link(address.link)?.joint.spring(drive.axis);
                let q = position(multibody, address.link, drive.axis);
                let velocity = multibody.generalized_velocity()[address.coordinate];
                let damping = multibody.damping()[address.coordinate];
                Some(f64::from(stiffness * (rest - q) - damping * velocity) * drive.units)
            })
            .collect()
    }

    /// Returns the largest speed of palm and joints (m/s, rad/s); NaN if one is not a number.
    pub(crate) fn fastest(&self, world: &World) -> f64 {
        let joints = self.drives.iter().map(|drive| drive.state(world)[1]);
        let palm = self.bodies.first().and_then(|palm| world.bodies.get(*palm));
        let palm = palm.map_or([f64::NAN; 2], |palm| {
            let turning = f64::from(palm.angvel().length());
            [meters(palm.linvel().length()), turning]
        });
        most(joints.chain(palm))
    }

    /// Returns the rigid bodies that have shapes, the palm first.
    pub(crate) fn bodies(&self) -> &[RigidBodyHandle] {
        &self.bodies
    }

    /// Returns the number of fingers that have one of these bodies, the palm counting as one.
    pub(crate) fn finger_count(&self, of_bodies: impl Iterator<Item = usize>) -> usize {
        let mut fingers: Vec<usize> = of_bodies.map(|body| self.fingers[body]).collect();
        fingers.sort_unstable();
        fingers.dedup();
        fingers.len()
    }

    /// Returns the number of rigid bodies, the palm included.
    pub(crate) fn body_count(&self) -> usize {
        self.bodies.len()
    }
}

/// Indices of a body's joint in its finger's multibody; they change when the palm is halted.
#[derive(Debug, Clone, Copy)]
struct JointAddress {
    link: usize,
    /// First of its coordinates in the multibody's vectors.
    coordinate: usize,
}

/// Returns the multibody of a body and the indices of its joint there.
fn finger(
    fingers: &MultibodyJointSet,
    body: RigidBodyHandle,
) -> Option<(&Multibody, JointAddress)> {
    let at = *fingers.rigid_body_link(body)?;
    let multibody = fingers.get_multibody(at.multibody)?;
    Some((multibody, joint_address(multibody, at.id)?))
}

/// As [`finger`], to be changed.
fn finger_mut(
    fingers: &mut MultibodyJointSet,
    body: RigidBodyHandle,
) -> Option<(&mut Multibody, JointAddress)> {
    let at = *fingers.rigid_body_link(body)?;
    let multibody = fingers.get_multibody_mut(at.multibody)?;
    let address = joint_address(multibody, at.id)?;
    Some((multibody, address))
}

fn joint_address(multibody: &Multibody, link: usize) -> Option<JointAddress> {
    let coordinate = multibody.link(link)?.assembly_id();
    Some(JointAddress { link, coordinate })
}

fn link_of(multibody: &Multibody, body: RigidBodyHandle) -> Option<&MultibodyLink> {
    multibody
        .links()
        .find(|link| link.rigid_body_handle() == body)
}

fn position(multibody: &Multibody, link: usize, axis: usize) -> f32 {
    multibody
        .link(link)
        .map_or(f32::NAN, |link| link.joint.coords()[axis])
}

/// Returns the largest of some numbers without their signs; NaN if one is not a number.
fn most(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.fold(0.0, |most: f64, number| {
        if number.is_nan() || most.is_nan() {
            f64::NAN
        } else {
            most.max(number.abs())
        }
    })
}

/// Returns for each group the one that carries it, and the pose of the link that does in that one's body;
/// `None` for the palm's.
fn parents(groups: &[RigidGroup], model: &RobotModel) -> Vec<Option<(usize, Pose<Body, Link>)>> {
    let mut body_of_link = vec![(0, Pose::identity()); model.links().len()];
    for (idx, group) in groups.iter().enumerate() {
        for (link, body_from_link) in &group.links {
            body_of_link[*link] = (idx, *body_from_link);
        }
    }
    let roots = groups.iter().map(|group| &model.links()[group.root]);
    roots
        .map(|root| root.parent.map(|parent| body_of_link[parent]))
        .collect()
}

/// Returns for each group the first of its finger; the palm's own is 0.
fn fingers(parents: &[Option<(usize, Pose<Body, Link>)>]) -> Vec<usize> {
    let mut fingers = Vec::with_capacity(parents.len());
    for (idx, parent) in parents.iter().enumerate() {
        fingers.push(match parent {
            Some((parent, _)) if *parent > 0 => fingers[*parent],
            _ => idx,
        });
    }
    fingers
}

/// Returns the collision groups of a shape of the hand.
fn collision_groups(shape: &HandShape, scene: &SceneConfig) -> InteractionGroups {
    let groups = match shape.finger {
        Some(finger) if scene.fingers_touch => groups::finger(finger),
        _ => groups::hand(),
    };
    match shape.finger {
        _ if !scene.fingers_touch_palm => groups,
        None => groups::with_fingers(groups),
        Some(_) if shape.touches_palm => groups::with_palm(groups),
        Some(_) => groups,
    }
}

/// Returns the colliders of the links of a rigid group, placed in the frame of its body.
fn colliders(
    group: &RigidGroup,
    shapes: &[LinkShape],
    scene: &SceneConfig,
) -> impl Iterator<Item = ColliderBuilder> {
    group.links.iter().flat_map(move |(link, body_from_link)| {
        let of_link = shapes
            .iter()
            .filter(move |shape| shape.of_hand.link == *link);
        of_link.map(move |shape| {
            ColliderBuilder::new(shape.engine.clone())
                .density(0.0)
                .friction(real(scene.friction))
                .collision_groups(collision_groups(&shape.of_hand, scene))
                .position(
                    engine_pose(&(*body_from_link * shape.link_from_shape))
                        * shape.shape_from_engine,
                )
        })
    })
}

/// Returns a joint that leaves a body free in the world, which waits at `parking`.
fn free_joint(parking: EnginePose) -> GenericJoint {
    GenericJointBuilder::new(JointAxesMask::empty())
        .local_frame1(parking)
        .build()
}

/// Inserts the root of a finger at `parking`: a body with the palm's mass whose joint in the world is
/// commanded.
fn insert_finger_root(
    world: &mut World,
    mass: MassProperties,
    parking: EnginePose,
) -> (RigidBodyHandle, Option<MultibodyJointHandle>) {
    let anchor = world.bodies.insert(RigidBodyBuilder::fixed());
    let body = world.bodies.insert(movable(mass));
    let free = free_joint(parking);
    let joint = world.multibodies.insert_kinematic(anchor, body, free, true);
    (body, joint)
}

/// Returns a body with a mass that nothing but its joints holds.
fn movable(mass: MassProperties) -> RigidBodyBuilder {
    RigidBodyBuilder::dynamic()
        .gravity_scale(0.0)
        .can_sleep(false)
        .additional_mass_properties(mass)
}

/// Returns the velocity (linear, then angular) that takes a free link from `now` to
/// `world_from_link` in `seconds`, in the world's axes.
fn twist(now: &EnginePose, world_from_link: &EnginePose, seconds: f32) -> [f32; 6] {
    let linear = (world_from_link.translation - now.translation) / seconds;
    let mut turn = world_from_link.rotation * now.rotation.inverse();
    if turn.w < 0.0 {
        turn = -turn;
    }
    let angular = turn.normalize().to_scaled_axis() / seconds;
    [
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use rapier3d::prelude::{JointAxis, MotorModel};

    use super::*;
    use crate::{
        fixture,
        units::{linear_stiffness, mass},
    };

    /// A palm with one finger of 10 cm along x that turns about y, down where positive.
    pub(super) const FINGER: &str = r#"<robot name="finger">
        <link name="palm">
          <inertial><mass value="1"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
        </link>
        <link name="rod">
          <inertial><origin xyz="0.05 0 0"/><mass value="0.05"/>
            <inertia ixx="1e-5" ixy="0" ixz="0" iyy="4e-5" iyz="0" izz="4e-5"/></inertial>
        </link>
        <link name="tip">
          <collision><geometry><sphere radius="0.01"/></geometry></collision>
        </link>
        <joint name="knuckle" type="revolute">
          <parent link="palm"/><child link="rod"/><axis xyz="0 1 0"/>
          <limit lower="-1.5" upper="1.5" effort="0.7" velocity="7"/>
        </joint>
        <joint name="end" type="fixed">
          <origin xyz="0.1 0 0"/><parent link="rod"/><child link="tip"/>
        </joint>
      </robot>"#;

    pub(super) fn finger(scene: &SceneConfig) -> (World, HandBodies) {
        of_urdf(scene, FINGER)
    }

    fn of_urdf(scene: &SceneConfig, urdf: &str) -> (World, HandBodies) {
        let model = RobotModel::from_urdf(urdf).unwrap();
        let mut world = World::empty(scene);
        let hand = HandBodies::insert(&mut world, scene, &model).unwrap();
        (world, hand)
    }

    /// Lets a finger whose tip is 10 cm along x press down on a plate with a spring. Returns its position, the
    /// most that its drive gave, and the force on the plate in newtons.
    fn pressing(urdf: &str, scene: &SceneConfig, q_command: f64) -> [f64; 3] {
        let (mut world, hand) = of_urdf(scene, urdf);
        hand.place(&mut world, &Pose::identity(), &[0.0]);
        let stiffness_n_per_m = 1000.0;
        let plate_at = EnginePose::translation(length(0.1), 0.0, length(-0.0205));
        let ground = world.bodies.insert(RigidBodyBuilder::fixed());
        let plate = world.bodies.insert(
            RigidBodyBuilder::dynamic()
                .pose(plate_at)
                .gravity_scale(0.0)
                .additional_mass(mass(1.0))
                .can_sleep(false),
        );
        world.colliders.insert_with_parent(
            ColliderBuilder::cuboid(length(0.05), length(0.05), length(0.01))
                .density(0.0)
                .friction(0.0)
                .collision_groups(groups::object()),
            plate,
            &mut world.bodies,
        );
        let free_along_z = JointAxesMask::LOCKED_FIXED_AXES.difference(JointAxesMask::LIN_Z);
        let [stiffness, damping] = [stiffness_n_per_m, 60.0].map(linear_stiffness);
        let spring = GenericJointBuilder::new(free_along_z)
            .local_frame1(plate_at)
            .motor_model(JointAxis::LinZ, MotorModel::ForceBased)
            .set_motor(JointAxis::LinZ, 0.0, 0.0, stiffness, damping)
            .build();
        world.impulse_joints.insert(ground, plate, spring, true);
        let mut most: f64 = 0.0;
        for _ in 0..1000 {
            hand.drive(&mut world, &[q_command]);
            world.step().unwrap();
            most = most.max(hand.torques(&world)[0].abs());
        }
        let down_m = -0.0205 - meters(world.bodies[plate].translation().z);
        [hand.positions(&world)[0], most, stiffness_n_per_m * down_m]
    }

    #[test]
    fn a_finger_presses_with_its_torque_limit_and_never_more() {
        let mut scene = fixture::scene();
        scene.friction = 0.0;
        let [q, most, force_n] = pressing(FINGER, &scene, 1.5);
        let limit = scene.drive.torque_limit;
        assert!(most < 1.02 * limit, "{most} Nm");
        let torque = force_n * 0.1 * q.cos();
        assert!((torque / limit - 1.0).abs() < 0.05, "{torque} Nm");
    }

    #[test]
    fn a_sliding_finger_presses_with_its_force_limit_and_never_more() {
        let mut scene = fixture::scene();
        scene.friction = 0.0;
        let turning = r#"type="revolute">
          <parent link="palm"/><child link="rod"/><axis xyz="0 1 0"/>"#;
        let sliding = r#"type="prismatic">
          <parent link="palm"/><child link="rod"/><axis xyz="0 0 -1"/>"#;
        assert!(FINGER.contains(turning));
        let urdf = FINGER.replace(turning, sliding);
        let [q, most, force_n] = pressing(&urdf, &scene, 0.1);
        let limit = scene.drive.torque_limit;
        assert!(most < 1.02 * limit, "{most} N");
        assert!((force_n / limit - 1.0).abs() < 0.05, "{force_n} N");
        // It has slid half a millimeter to the plate, by the plate's displacement, and slightly into it.
        let inside_m = q - 0.0005 - force_n / 1000.0;
        assert!((0.0..2e-4).contains(&inside_m), "{inside_m} m");
    }

    #[test]
    fn a_free_finger_reaches_its_command_and_stops_there() {
        let scene = fixture::scene();
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Pose::identity(), &[-0.4]);
        for _ in 0..250 {
            hand.drive(&mut world, &[0.6]);
            world.step().unwrap();
        }
        assert!((hand.positions(&world)[0] - 0.6).abs() < 1e-4);
        assert!(hand.fastest(&world) < 1e-3);
    }

    #[test]
    fn a_halted_palm_makes_no_difference_to_its_fingers() {
        let scene = fixture::scene();
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Pose::identity(), &[-0.4]);
        let mut halted = world.fork();
        hand.halt(&mut halted);
        let mut farthest: f64 = 0.0;
        for _ in 0..50 {
            let [moved, still] = [&mut world, &mut halted].map(|world| {
                hand.drive(world, &[0.6]);
                world.step().unwrap();
                (hand.positions(world)[0], hand.torques(world)[0])
            });
            assert!((moved.0 - still.0).abs() < 1e-6, "{moved:?}, {still:?}");
            assert!((moved.1 - still.1).abs() < 1e-4, "{moved:?}, {still:?}");
            farthest = farthest.max(still.0 + 0.4);
        }
        assert!(farthest > 0.3, "{farthest}");
    }

    #[test]
    fn a_command_beyond_an_end_stop_ends_there() {
        let scene = fixture::scene();
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Pose::identity(), &[1.4]);
        for _ in 0..250 {
            hand.drive(&mut world, &[3.0]);
            world.step().unwrap();
        }
        assert!((hand.positions(&world)[0] - 1.5).abs() < 1e-3);
    }

    /// A slide whose ball is always in the palm, and on it a tip that slides into the palm's plate from 10 cm away.
    #[test]
    fn a_finger_stops_at_the_palm_and_its_first_link_overlaps_it() {
        let link = |name: &str, shape: &str| {
            format!(
                r#"<link name="{name}"><inertial><mass value="0.05"/>
                  <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
                  <collision><geometry>{shape}</geometry></collision></link>"#
            )
        };
        let joint = |name: &str, [parent, child]: [&str; 2], [x, axis]: [&str; 2]| {
            format!(
                r#"<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
                  <origin xyz="{x} 0 0"/><axis xyz="{axis}"/>
                  <limit lower="-0.2" upper="0.2" effort="1" velocity="1"/></joint>"#
            )
        };
        let urdf = [
            r#"<robot name="h">"#,
            &link("palm", r#"<box size="0.02 0.1 0.1"/>"#),
            &link("slide", r#"<sphere radius="0.095"/>"#),
            &link("tip", r#"<sphere radius="0.01"/>"#),
            &joint("first", ["palm", "slide"], ["0.1", "0 0 1"]),
            &joint("second", ["slide", "tip"], ["0", "-1 0 0"]),
            "</robot>",
        ]
        .concat();
        let end_m = |fingers_touch_palm: bool| {
            let mut scene = fixture::scene();
            scene.fingers_touch_palm = fingers_touch_palm;
            let (mut world, hand) = of_urdf(&scene, &urdf);
            hand.place(&mut world, &Pose::identity(), &[0.0, 0.0]);
            for _ in 0..500 {
                hand.drive(&mut world, &[0.0, 0.12]);
                world.step().unwrap();
            }
            hand.positions(&world)
        };
        for (found, expected_m) in [(end_m(false), 0.12), (end_m(true), 0.08)] {
            assert!((found[1] - expected_m).abs() < 5e-4, "{found:?}");
            assert!(found[0].abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn the_palm_arrives_however_it_is_turned() {
        let scene = fixture::scene();
        let (mut world, hand) = finger(&scene);
        let turns =
            [0.0, 1.0, 2.5, 3.1].map(|angle| Vector3::new(0.3, -1.0, 0.5).normalize() * angle);
        for turn in turns {
            let goal = Pose::from_parts([0.1, -0.2, 0.3], UnitQuaternion::from_scaled_axis(turn));
            hand.place(&mut world, &Pose::identity(), &[0.0]);
            for left in (1..=25).rev() {
                hand.move_palm(&mut world, &goal, f64::from(left) * scene.time_step_s);
                hand.drive(&mut world, &[0.0]);
                world.step().unwrap();
            }
            let found = hand.table_from_palm(&world);
            assert!((found.translation.vector - goal.translation.vector).norm() < 1e-4);
            assert!(found.rotation.angle_to(&goal.rotation) < 1e-3, "{turn}");
        }
    }
}
