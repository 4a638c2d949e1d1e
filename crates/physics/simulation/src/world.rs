//! The physics engine's state as one value that can be copied.

use nalgebra::{UnitQuaternion, Vector3};
use rapier3d::{
    dynamics::SpringCoefficients,
    prelude::{
        BroadPhaseBvh, CCDSolver, ColliderBuilder, ColliderSet, Group, ImpulseJointSet,
        IntegrationParameters, InteractionGroups, InteractionTestMode, IslandManager,
        MultibodyJointSet, NarrowPhase, PhysicsPipeline, RigidBody, RigidBodyBuilder,
        RigidBodyHandle, RigidBodySet, RigidBodyType, SoftBodySet, Vector,
    },
};
use spatial::{Pose, Table};

use crate::{
    config::{SceneConfig, Support},
    units::{EngineFrame, length, lengths, meters, pose_from_engine, real},
};

/// Gravity in meters per second squared, rounded as MuJoCo's default is.
const GRAVITY_M_PER_S2: f64 = 9.81;
/// Damping ratio of contacts: overlapping bodies part as fast as they can without swinging. With the engine's
/// default of 10, which is for stacks of boxes, they part seven times slower, and held objects sink in.
const CONTACT_DAMPING_RATIO: f32 = 1.0;
/// Natural frequency of contacts in hertz, twice that with a table at rest, as in the engine: with its 30 Hz, one
/// in ten motions that hold has a finger deeper than 5 mm in the object.
const CONTACT_HZ: f32 = 60.0;
/// Displacement in meters within which a shape keeps its box in the broad phase; it sets the engine's unit of length.
/// Shapes whose boxes, grown by it, overlap are pairs, and each pair is looked at in every step: with the engine's
/// default, 40 mm, nearly every link is paired with all of the object and the other fingers.
const BROAD_PHASE_MARGIN_M: f64 = 0.001;
/// The engine's broad-phase margin, in its units of length (`BroadPhaseBvh::CHANGE_DETECTION_FACTOR`).
const BROAD_PHASE_MARGIN: f64 = 0.04;
/// Half the edge of the table in meters: no object that can still be grasped leaves it.
const TABLE_HALF_EDGE_M: f64 = 1.0;
/// Half the thickness of the table in meters.
const TABLE_HALF_THICKNESS_M: f64 = 0.025;

/// Collision groups: the hand touches object and table, and its fingers each other and the palm if configured.
pub(crate) mod groups {
    use super::{Group, InteractionGroups, InteractionTestMode};

    /// Number of groups that are not fingers.
    const OTHERS: usize = 5;

    const HAND: Group = Group::GROUP_1;
    const OBJECT: Group = Group::GROUP_2;
    const TABLE: Group = Group::GROUP_3;
    /// A palm that fingers touch, and the shapes of fingers that touch it.
    const PALM: Group = Group::GROUP_4;
    const ON_PALM: Group = Group::GROUP_5;

    const fn groups(own: Group, others: Group) -> InteractionGroups {
        InteractionGroups::new(own, others, InteractionTestMode::And)
    }

    /// Groups of the palm's shapes, and of fingers that do not touch each other.
    pub(crate) const fn hand() -> InteractionGroups {
        groups(HAND, OBJECT.union(TABLE))
    }

    /// Groups of the shapes of a finger, by its number from 0, that touches the other fingers.
    pub(crate) fn finger(number: usize) -> InteractionGroups {
        // Fingers beyond the last group share it.
        let bit = (OTHERS + number).min(31);
        let own = Group::from_bits_retain(1 << bit);
        let others = HAND.union(OBJECT).union(TABLE).union(PALM).union(ON_PALM);
        let fingers = Group::ALL.difference(others);
        groups(
            HAND.union(own),
            OBJECT.union(TABLE).union(fingers.difference(own)),
        )
    }

    /// Adds to the groups of the palm's shapes that fingers touch them.
    pub(crate) fn with_fingers(of_palm: InteractionGroups) -> InteractionGroups {
        groups(
            of_palm.memberships.union(PALM),
            of_palm.filter.union(ON_PALM),
        )
    }

    /// Adds to the groups of a finger's shape that it touches the palm.
    pub(crate) fn with_palm(of_finger: InteractionGroups) -> InteractionGroups {
        groups(
            of_finger.memberships.union(ON_PALM),
            of_finger.filter.union(PALM),
        )
    }

    /// Whether a shape is one of the hand's.
    pub(crate) fn is_hand(of: InteractionGroups) -> bool {
        of.memberships.contains(HAND)
    }

    /// Groups of the object's shapes.
    pub(crate) const fn object() -> InteractionGroups {
        groups(OBJECT, HAND.union(TABLE))
    }

    /// Groups of the table.
    pub(crate) const fn table() -> InteractionGroups {
        groups(TABLE, HAND.union(OBJECT))
    }
}

/// Everything that a physics step reads and writes.
pub(crate) struct World {
    /// Rigid bodies: object, table, links of the hand.
    pub(crate) bodies: RigidBodySet,
    /// Their shapes.
    pub(crate) colliders: ColliderSet,
    /// The hand.
    pub(crate) multibodies: MultibodyJointSet,
    /// Joints between free bodies; only tests add some.
    pub(crate) impulse_joints: ImpulseJointSet,
    /// Contacts of the last step.
    pub(crate) narrow_phase: NarrowPhase,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    soft_bodies: SoftBodySet,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
    table: Option<RigidBodyHandle>,
    frame: FrameMotion,
    gravity: Vector,
}

/// Displacement and velocity of the engine's coordinates over the table.
///
/// While the palm is lifted it stands still in them, the table sinks, and a held object is at rest;
/// nothing else is different in a frame that moves evenly.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct FrameMotion {
    offset_m: Vector3<f64>,
    velocity_m_per_s: Vector3<f64>,
}

impl World {
    /// Returns a world with nothing in it but a table whose surface is z = 0, or nothing at all.
    pub(crate) fn of(scene: &SceneConfig) -> Self {
        let mut world = Self::empty(scene);
        if scene.support == Support::Nothing {
            world.gravity = Vector::ZERO;
            return world;
        }
        let table = world
            .bodies
            .insert(RigidBodyBuilder::fixed().translation(Vector::new(
                0.0,
                0.0,
                -length(TABLE_HALF_THICKNESS_M),
            )));
        let [half_edge, half_thickness] = [TABLE_HALF_EDGE_M, TABLE_HALF_THICKNESS_M].map(length);
        world.colliders.insert_with_parent(
            ColliderBuilder::cuboid(half_edge, half_edge, half_thickness)
                .friction(real(scene.table_friction.unwrap_or(scene.friction)))
                .collision_groups(groups::table()),
            table,
            &mut world.bodies,
        );
        world.table = Some(table);
        world
    }

    /// Returns an empty world.
    pub(crate) fn empty(scene: &SceneConfig) -> Self {
        let softness = |hz| SpringCoefficients::new(hz, CONTACT_DAMPING_RATIO);
        let unit_m = BROAD_PHASE_MARGIN_M / BROAD_PHASE_MARGIN;
        let in_units = |length_m: f64| real(length_m / unit_m);
        let defaults = IntegrationParameters::default();
        let parameters = IntegrationParameters {
            contact_softness: softness(CONTACT_HZ),
            static_contact_softness: softness(2.0 * CONTACT_HZ),
            dt: real(scene.time_step_s),
            length_unit: length(unit_m),
            normalized_allowed_linear_error: in_units(f64::from(
                defaults.normalized_allowed_linear_error,
            )),
            normalized_max_corrective_velocity: in_units(f64::from(
                defaults.normalized_max_corrective_velocity,
            )),
            normalized_max_linear_velocity: in_units(f64::from(
                defaults.normalized_max_linear_velocity,
            )),
            num_solver_iterations: scene.substeps as usize,
            // Nothing here is fast enough to pass through anything.
            max_ccd_substeps: 0,
            num_internal_pgs_iterations: 4,
            num_internal_stabilization_iterations: 2,
            // By default friction acts only after bodies that overlap have been pushed apart: dragged
            // bodies then slide as if they were smooth.
            friction_in_bias_pass: true,
            normalized_prediction_distance: in_units(scene.prediction_m),
            normalized_contact_recycle_distance: in_units(scene.contact_recycle_m),
            ..defaults
        };
        Self {
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            multibodies: MultibodyJointSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            narrow_phase: NarrowPhase::new(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            soft_bodies: SoftBodySet::new(),
            parameters,
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            table: None,
            frame: FrameMotion::default(),
            gravity: Vector::new(0.0, 0.0, -length(GRAVITY_M_PER_S2)),
        }
    }

    /// Returns an independent copy.
    pub(crate) fn fork(&self) -> Self {
        Self {
            bodies: self.bodies.clone(),
            colliders: self.colliders.clone(),
            multibodies: self.multibodies.clone(),
            impulse_joints: self.impulse_joints.clone(),
            narrow_phase: self.narrow_phase.clone(),
            islands: self.islands.clone(),
            broad_phase: self.broad_phase.clone(),
            soft_bodies: self.soft_bodies.clone(),
            parameters: self.parameters,
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
            table: self.table,
            frame: self.frame,
            gravity: self.gravity,
        }
    }

    /// Advances by one time step.
    ///
    /// # Errors
    ///
    /// Fails if a body's numbers overflowed in it.
    pub(crate) fn step(&mut self) -> Result<(), Overflow> {
        self.pipeline.step(
            self.gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut self.soft_bodies,
            &mut self.ccd,
            &(),
            &(),
        );
        self.frame.offset_m += self.frame.velocity_m_per_s * f64::from(self.parameters.dt);
        if self.pipeline.quarantine().is_empty() {
            Ok(())
        } else {
            Err(Overflow)
        }
    }

    /// From now on the engine's coordinates move so that they have moved by `offset_m` in `seconds`;
    /// the `object` keeps its velocity over the table.
    pub(crate) fn carry(&mut self, object: RigidBodyHandle, offset_m: &Vector3<f64>, seconds: f64) {
        let velocity_m_per_s = (offset_m - self.frame.offset_m) / seconds;
        let faster = lengths(&(velocity_m_per_s - self.frame.velocity_m_per_s));
        self.frame.velocity_m_per_s = velocity_m_per_s;
        if faster == Vector::ZERO {
            return;
        }
        if let Some(body) = self.bodies.get_mut(object) {
            let velocity = body.linvel();
            body.set_linvel(velocity - faster, true);
        }
        if let Some(table) = self.table.and_then(|table| self.bodies.get_mut(table)) {
            table.set_body_type(RigidBodyType::KinematicVelocityBased, true);
            table.set_linvel(-lengths(&velocity_m_per_s), true);
        }
    }

    /// Takes away gravity and the table, and pulls the `object` with an acceleration.
    pub(crate) fn pull(&mut self, object: RigidBodyHandle, acceleration_m_per_s2: &Vector3<f64>) {
        self.gravity = Vector::ZERO;
        if let Some(table) = self.table.take() {
            let (islands, colliders) = (&mut self.islands, &mut self.colliders);
            let (joints, fingers) = (&mut self.impulse_joints, &mut self.multibodies);
            let soft = &mut self.soft_bodies;
            self.bodies
                .remove(table, islands, colliders, joints, fingers, soft, true);
        }
        if let Some(body) = self.bodies.get_mut(object) {
            let force = lengths(acceleration_m_per_s2) * body.mass();
            body.reset_forces(true);
            body.add_force(force, true);
        }
    }

    /// Returns the physics time step in seconds.
    pub(crate) fn step_s(&self) -> f64 {
        f64::from(self.parameters.dt)
    }

    /// Returns the number of solver substeps in a physics step.
    pub(crate) fn substep_count(&self) -> f64 {
        self.parameters.num_solver_iterations as f64
    }

    /// Whether a body that does not rise lies below all of some others.
    pub(crate) fn is_below(&self, body: RigidBodyHandle, others: &[RigidBodyHandle]) -> bool {
        let shapes = |body: RigidBodyHandle| {
            let body = self.bodies.get(body);
            let handles = body.into_iter().flat_map(RigidBody::colliders);
            handles.filter_map(|handle| self.colliders.get(*handle))
        };
        let top = shapes(body)
            .map(|shape| shape.compute_aabb().maxs.z)
            .fold(f32::NEG_INFINITY, f32::max);
        let rises = self
            .bodies
            .get(body)
            .is_none_or(|body| meters(body.linvel().z) + self.frame.velocity_m_per_s.z > 0.0);
        !rises
            && others
                .iter()
                .flat_map(|other| shapes(*other))
                .all(|shape| shape.compute_aabb().mins.z > top)
    }

    /// Returns a body's pose in the engine's frame; the caller names the body's.
    pub(crate) fn engine_from_body<Body>(&self, body: RigidBodyHandle) -> Pose<EngineFrame, Body> {
        pose_from_engine(self.bodies[body].position())
    }

    /// Returns a body's pose over the table; the caller names its frame.
    pub(crate) fn table_from_body<Body>(&self, body: RigidBodyHandle) -> Pose<Table, Body> {
        self.table_from_engine() * self.engine_from_body(body)
    }

    /// Pose of the engine's frame in the table's.
    pub(crate) fn table_from_engine(&self) -> Pose<Table, EngineFrame> {
        Pose::from_parts(self.frame.offset_m, UnitQuaternion::identity())
    }
}

/// A body's numbers overflowed, and the engine disabled it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Overflow;
