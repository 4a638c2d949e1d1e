//! The hand as a multibody: a palm that follows its path and fingers that are driven.

mod bodies;
#[cfg(test)]
mod closed_forms;
mod controller;
mod feedforward;

use nalgebra::Isometry3;
use rapier3d::{
    math::Pose,
    prelude::{
        ColliderBuilder, GenericJointBuilder, JointAxesMask, Multibody, MultibodyIndex,
        MultibodyLink, RigidBodyBuilder, RigidBodyHandle,
    },
};
use robot::{Bodies, JointKind, RobotModel};

pub(crate) use self::bodies::engine_shape;
use self::{
    bodies::{RigidGroup, engine_joint, mass_properties, rigid_groups},
    controller::Controller,
};
use crate::{
    config::SceneConfig,
    error::SimulationError,
    precision::{isometry, pose, real},
    world::{World, groups},
};

/// Height in meters at which the hand waits until it is placed.
const PARKING_HEIGHT_M: f64 = 1.0;
/// Coordinates of the palm: three along the axes, three about them.
const DIMENSIONS: usize = 6;

/// The hand's place in a world and its drives.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    bodies: Vec<RigidBodyHandle>,
    multibody: MultibodyIndex,
    palm: usize,
    drives: Vec<Drive>,
    /// Index into `drives` of each independent joint.
    joints: Vec<usize>,
    /// What the controller knows of masses and inertias.
    dynamics: Bodies,
}

/// The drive of one movable link.
#[derive(Debug, Clone, Copy)]
struct Drive {
    /// Link of the multibody.
    link: usize,
    /// First of its coordinates in the multibody's vectors.
    coordinate: usize,
    /// Its axis among the six of a joint.
    axis: usize,
    /// The independent joint that commands it.
    joint: usize,
    multiplier: f32,
    offset: f32,
    controller: Controller,
}

/// What carries the palm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PalmJoint {
    /// It follows its path whatever acts on it.
    Driven,
    /// Nothing: it flies.
    #[cfg(test)]
    Free,
}

impl Hand {
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
        if model.links().iter().all(|link| link.collisions.is_empty()) {
            return Err(SimulationError::NoCollisions);
        }
        let groups = rigid_groups(model);
        let anchor = world.bodies.insert(RigidBodyBuilder::fixed());
        let mut bodies = Vec::with_capacity(groups.len());
        let mut body_of_link = vec![(0, Isometry3::identity()); model.links().len()];
        let mut palm_joint = None;
        for (idx, group) in groups.iter().enumerate() {
            let body = world.bodies.insert(
                RigidBodyBuilder::dynamic()
                    .gravity_scale(0.0)
                    .can_sleep(false)
                    .additional_mass_properties(mass_properties(
                        model,
                        group,
                        scene.hand_mass_scale,
                    )?),
            );
            for (link, body_from_link) in &group.links {
                body_of_link[*link] = (idx, *body_from_link);
                for collision in &model.links()[*link].collisions {
                    let (shape, shape_from_engine) = engine_shape(&collision.shape);
                    world.colliders.insert_with_parent(
                        ColliderBuilder::new(shape)
                            .density(0.0)
                            .friction(real(scene.friction))
                            .collision_groups(groups::hand())
                            .user_data(idx as u128)
                            .position(
                                pose(&(body_from_link * collision.link_from_shape))
                                    * shape_from_engine,
                            ),
                        body,
                        &mut world.bodies,
                    );
                }
            }
            let link = &model.links()[group.root];
            let handle = match link.parent.map(|parent| body_of_link[parent]) {
                None => {
                    let free = GenericJointBuilder::new(JointAxesMask::empty())
                        .local_frame1(Pose::translation(0.0, 0.0, real(PARKING_HEIGHT_M)));
                    let joints = &mut world.multibodies;
                    match palm {
                        PalmJoint::Driven => {
                            joints.insert_kinematic(anchor, body, free.build(), true)
                        }
                        #[cfg(test)]
                        PalmJoint::Free => joints.insert(anchor, body, free.build(), true),
                    }
                }
                Some((parent, parent_body_from_parent)) => world.multibodies.insert(
                    bodies[parent],
                    body,
                    engine_joint(link, &parent_body_from_parent),
                    true,
                ),
            };
            palm_joint = palm_joint.or(handle);
            bodies.push(body);
        }
        for body in &bodies {
            let body = &mut world.bodies[*body];
            body.recompute_mass_properties_from_colliders(&world.colliders);
        }
        let multibody = world
            .multibodies
            .rigid_body_link(anchor)
            .map(|link| link.multibody);
        let multibody = multibody.ok_or(SimulationError::NoCollisions)?;
        let mut hand = Self {
            bodies,
            multibody,
            palm: 1,
            drives: Vec::new(),
            joints: Vec::new(),
            dynamics: Bodies::new(model)
                .with_mass_scale(scene.hand_mass_scale)
                .with_armature(scene.drive.armature),
        };
        hand.configure(world, scene, model, &groups);
        Ok(hand)
    }

    /// Sets damping, armature and drives once the multibody knows that its root is fixed.
    fn configure(
        &mut self,
        world: &mut World,
        scene: &SceneConfig,
        model: &RobotModel,
        groups: &[RigidGroup],
    ) {
        let Some(multibody) = world.multibodies.get_multibody_mut(self.multibody) else {
            return;
        };
        multibody.set_self_contacts_enabled(false);
        multibody.forward_kinematics(&world.bodies, true);
        multibody.update_rigid_bodies(&mut world.bodies, true);
        multibody.damping_mut().fill(0.0);
        self.joints = vec![0; model.dof()];
        for (idx, group) in groups.iter().enumerate() {
            let link = &model.links()[group.root];
            let (Some(joint), Some(kind)) = (link.joint, link.kind) else {
                continue;
            };
            // Link 0 of the multibody is the anchor.
            let number = idx + 1;
            let coordinate = multibody.link(number).map_or(0, MultibodyLink::assembly_id);
            let limits = &model.joints()[joint];
            let (multiplier, offset) = (link.multiplier, link.offset);
            let ends = [limits.lower, limits.upper].map(|end| multiplier * end + offset);
            if limits.link == group.root {
                self.joints[joint] = self.drives.len();
            }
            self.drives.push(Drive {
                link: number,
                coordinate,
                axis: match kind {
                    JointKind::Revolute | JointKind::Continuous => 3,
                    JointKind::Prismatic => 0,
                },
                joint,
                multiplier: real(multiplier),
                offset: real(offset),
                controller: Controller::new(scene, ends),
            });
            multibody.damping_mut()[coordinate] = real(scene.drive.damping);
            multibody.armature_mut()[coordinate] = real(scene.drive.armature);
        }
        let inverse = multibody.dof_inverse_inertia(&world.bodies);
        for drive in &mut self.drives {
            drive.controller.inverse_inertia = inverse[drive.coordinate];
        }
    }

    /// Puts the hand somewhere at once, at rest.
    pub(crate) fn place(&self, world: &mut World, table_from_palm: &Isometry3<f64>, q: &[f64]) {
        let Some(multibody) = world.multibodies.get_multibody_mut(self.multibody) else {
            return;
        };
        let mut displacement = vec![0.0; multibody.ndofs()];
        if let Some(target) = displacement.get_mut(..DIMENSIONS) {
            target.copy_from_slice(&twist(multibody, self.palm, &pose(table_from_palm), 1.0));
        }
        for drive in &self.drives {
            let position = coordinate(multibody, drive);
            if let (Some(target), Some(q)) =
                (displacement.get_mut(drive.coordinate), q.get(drive.joint))
            {
                *target = drive.multiplier * real(*q) + drive.offset - position;
            }
        }
        multibody.apply_displacements(&displacement);
        multibody.generalized_velocity_mut().fill(0.0);
        multibody.forward_kinematics(&world.bodies, false);
        multibody.update_rigid_bodies(&mut world.bodies, true);
    }

    /// Gives the palm the velocity with which it is at `table_from_palm` in `seconds`.
    pub(crate) fn move_palm(
        &self,
        world: &mut World,
        table_from_palm: &Isometry3<f64>,
        seconds: f64,
    ) {
        let Some(multibody) = world.multibodies.get_multibody_mut(self.multibody) else {
            return;
        };
        let velocity = twist(multibody, self.palm, &pose(table_from_palm), real(seconds));
        for (idx, number) in velocity.into_iter().enumerate() {
            multibody.generalized_velocity_mut()[idx] = number;
        }
    }

    /// Sets every finger's torque for the next physics step.
    pub(crate) fn drive(&self, world: &mut World, q_command: &[f64]) {
        let Some(multibody) = world.multibodies.get_multibody_mut(self.multibody) else {
            return;
        };
        for drive in &self.drives {
            let Some(command) = q_command.get(drive.joint) else {
                continue;
            };
            let spring = drive.controller.spring(
                drive.multiplier * real(*command) + drive.offset,
                0.0,
                coordinate(multibody, drive),
                multibody.generalized_velocity()[drive.coordinate],
            );
            multibody.damping_mut()[drive.coordinate] = spring.damping;
            if let Some(link) = multibody.link_mut(drive.link) {
                link.joint
                    .set_spring(drive.axis, spring.stiffness, spring.rest);
            }
        }
    }

    /// Returns the pose of the palm in the table frame.
    pub(crate) fn table_from_palm(&self, world: &World) -> Isometry3<f64> {
        self.bodies
            .first()
            .and_then(|palm| world.bodies.get(*palm))
            .map_or_else(Isometry3::identity, |palm| isometry(palm.position()))
    }

    /// Returns the joint positions in radians.
    pub(crate) fn positions(&self, world: &World) -> Vec<f64> {
        let multibody = world.multibodies.get_multibody(self.multibody);
        self.joints
            .iter()
            .filter_map(|&drive| Some(f64::from(coordinate(multibody?, self.drives.get(drive)?))))
            .collect()
    }

    /// Returns the torque of each joint's drive (without end stops) in newton meters, as it was
    /// in the last physics step.
    #[cfg(test)]
    pub(crate) fn torques(&self, world: &World) -> Vec<f64> {
        let Some(multibody) = world.multibodies.get_multibody(self.multibody) else {
            return Vec::new();
        };
        self.joints
            .iter()
            .filter_map(|&drive| {
                let drive = self.drives.get(drive)?;
                let (stiffness, rest) = multibody.link(drive.link)?.joint.spring(drive.axis);
                let q = coordinate(multibody, drive);
                let velocity = multibody.generalized_velocity()[drive.coordinate];
                let damping = multibody.damping()[drive.coordinate];
                Some(f64::from(stiffness * (rest - q) - damping * velocity))
            })
            .collect()
    }

    /// Returns the largest speed of any coordinate (m/s, rad/s); NaN if one is not a number.
    pub(crate) fn fastest(&self, world: &World) -> f32 {
        world
            .multibodies
            .get_multibody(self.multibody)
            .map_or(f32::NAN, |multibody| {
                multibody
                    .generalized_velocity()
                    .iter()
                    .fold(0.0, |most: f32, speed| {
                        if speed.is_nan() || most.is_nan() {
                            f32::NAN
                        } else {
                            most.max(speed.abs())
                        }
                    })
            })
    }

    /// Returns the number of rigid bodies, the palm included.
    pub(crate) fn bodies_n(&self) -> usize {
        self.bodies.len()
    }
}

fn coordinate(multibody: &Multibody, drive: &Drive) -> f32 {
    multibody
        .link(drive.link)
        .map_or(f32::NAN, |link| link.joint.coords()[drive.axis])
}

/// Returns the velocity (linear, then angular) that takes a free link to `world_from_link` in
/// `seconds`, in the axes of its joint, which are the world's.
fn twist(multibody: &Multibody, link: usize, world_from_link: &Pose, seconds: f32) -> [f32; 6] {
    let Some(link) = multibody.link(link) else {
        return [0.0; DIMENSIONS];
    };
    let now = link.local_to_world();
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
    use nalgebra::{Translation3, UnitQuaternion, Vector3};
    use rapier3d::prelude::{JointAxis, MotorModel};

    use super::*;
    use crate::testing;

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

    pub(super) fn finger(scene: &SceneConfig) -> (World, Hand) {
        let model = RobotModel::from_urdf(FINGER).unwrap();
        let mut world = World::empty(scene);
        let hand = Hand::insert(&mut world, scene, &model).unwrap();
        (world, hand)
    }

    #[test]
    fn a_finger_presses_with_its_torque_limit_and_never_more() {
        let mut scene = testing::scene();
        scene.friction = 0.0;
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Isometry3::identity(), &[0.0]);
        // A plate below the tip, on a spring of 1,000 N/m along z.
        let stiffness = 1000.0;
        let ground = world.bodies.insert(RigidBodyBuilder::fixed());
        let plate = world.bodies.insert(
            RigidBodyBuilder::dynamic()
                .pose(Pose::translation(0.1, 0.0, -0.0205))
                .gravity_scale(0.0)
                .additional_mass(1.0)
                .can_sleep(false),
        );
        world.colliders.insert_with_parent(
            ColliderBuilder::cuboid(0.05, 0.05, 0.01)
                .density(0.0)
                .friction(0.0)
                .collision_groups(groups::object()),
            plate,
            &mut world.bodies,
        );
        let free_along_z = JointAxesMask::LOCKED_FIXED_AXES.difference(JointAxesMask::LIN_Z);
        let spring = GenericJointBuilder::new(free_along_z)
            .local_frame1(Pose::translation(0.1, 0.0, -0.0205))
            .motor_model(JointAxis::LinZ, MotorModel::ForceBased)
            .set_motor(JointAxis::LinZ, 0.0, 0.0, stiffness, 60.0)
            .build();
        world.impulse_joints.insert(ground, plate, spring, true);
        let mut most: f64 = 0.0;
        for _ in 0..1000 {
            hand.drive(&mut world, &[1.5]);
            world.step();
            most = most.max(hand.torques(&world)[0].abs());
        }
        let limit = scene.drive.torque_limit;
        assert!(most < 1.02 * limit, "{most} Nm");
        let down = f64::from(-0.0205 - world.bodies[plate].translation().z);
        let arm = 0.1 * hand.positions(&world)[0].cos();
        let torque = f64::from(stiffness) * down * arm;
        assert!((torque / limit - 1.0).abs() < 0.05, "{torque} Nm");
    }

    #[test]
    fn a_free_finger_reaches_its_command_and_stops_there() {
        let scene = testing::scene();
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Isometry3::identity(), &[-0.4]);
        for _ in 0..250 {
            hand.drive(&mut world, &[0.6]);
            world.step();
        }
        assert!((hand.positions(&world)[0] - 0.6).abs() < 1e-4);
        assert!(hand.fastest(&world) < 1e-3);
    }

    #[test]
    fn a_command_beyond_an_end_stop_ends_there() {
        let scene = testing::scene();
        let (mut world, hand) = finger(&scene);
        hand.place(&mut world, &Isometry3::identity(), &[1.4]);
        for _ in 0..250 {
            hand.drive(&mut world, &[3.0]);
            world.step();
        }
        assert!((hand.positions(&world)[0] - 1.5).abs() < 1e-3);
    }

    #[test]
    fn the_palm_arrives_however_it_is_turned() {
        let scene = testing::scene();
        let (mut world, hand) = finger(&scene);
        let turns =
            [0.0, 1.0, 2.5, 3.1].map(|angle| Vector3::new(0.3, -1.0, 0.5).normalize() * angle);
        for turn in turns {
            let goal = Isometry3::from_parts(
                Translation3::new(0.1, -0.2, 0.3),
                UnitQuaternion::from_scaled_axis(turn),
            );
            hand.place(&mut world, &Isometry3::identity(), &[0.0]);
            for left in (1..=25).rev() {
                hand.move_palm(&mut world, &goal, f64::from(left) * scene.time_step_s);
                hand.drive(&mut world, &[0.0]);
                world.step();
            }
            let found = hand.table_from_palm(&world);
            assert!((found.translation.vector - goal.translation.vector).norm() < 1e-4);
            assert!(found.rotation.angle_to(&goal.rotation) < 1e-3, "{turn}");
        }
    }
}
