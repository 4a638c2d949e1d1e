//! The physics engine's state as one value that can be copied.

use rapier3d::prelude::{
    BroadPhaseBvh, CCDSolver, ColliderBuilder, ColliderSet, Group, ImpulseJointSet,
    IntegrationParameters, InteractionGroups, InteractionTestMode, IslandManager,
    MultibodyJointSet, NarrowPhase, PhysicsPipeline, RigidBodyBuilder, RigidBodySet, SoftBodySet,
    Vector,
};

use crate::{config::SceneConfig, precision::real};

/// Standard gravity in meters per second squared.
const GRAVITY: f32 = 9.81;
/// Half the edge of the table in meters: nothing that is still in the game leaves it.
const TABLE_HALF_EDGE: f32 = 1.0;
/// Half the thickness of the table in meters.
const TABLE_HALF_THICKNESS: f32 = 0.025;

/// Who touches whom: the hand touches object and table, never itself.
pub(crate) mod groups {
    use super::{Group, InteractionGroups, InteractionTestMode};

    const HAND: Group = Group::GROUP_1;
    const OBJECT: Group = Group::GROUP_2;
    const TABLE: Group = Group::GROUP_3;

    const fn groups(own: Group, others: Group) -> InteractionGroups {
        InteractionGroups::new(own, others, InteractionTestMode::And)
    }

    /// Groups of the hand's shapes.
    pub(crate) const fn hand() -> InteractionGroups {
        groups(HAND, OBJECT.union(TABLE))
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
}

impl World {
    /// Returns a world with nothing in it but a table whose surface is z = 0.
    pub(crate) fn with_table(scene: &SceneConfig) -> Self {
        let mut world = Self::empty(scene);
        let table = world
            .bodies
            .insert(RigidBodyBuilder::fixed().translation(Vector::new(
                0.0,
                0.0,
                -TABLE_HALF_THICKNESS,
            )));
        world.colliders.insert_with_parent(
            ColliderBuilder::cuboid(TABLE_HALF_EDGE, TABLE_HALF_EDGE, TABLE_HALF_THICKNESS)
                .friction(real(scene.friction))
                .collision_groups(groups::table()),
            table,
            &mut world.bodies,
        );
        world
    }

    /// Returns a world with nothing in it.
    pub(crate) fn empty(scene: &SceneConfig) -> Self {
        let parameters = IntegrationParameters {
            dt: real(scene.time_step_s),
            // One substep holds with implicit drives; each further one costs as much as a step.
            num_solver_iterations: 1,
            // Nearly free, and stops the creep of held objects.
            num_internal_pgs_iterations: 2,
            normalized_prediction_distance: real(scene.prediction_m),
            ..IntegrationParameters::default()
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
        }
    }

    /// Returns a copy that evolves on its own.
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
        }
    }

    /// Advances by one time step; `false` if a body's numbers overflowed in it.
    pub(crate) fn step(&mut self) -> Finite {
        self.pipeline.step(
            Vector::new(0.0, 0.0, -GRAVITY),
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
        if self.pipeline.quarantine().is_empty() {
            Finite::Yes
        } else {
            Finite::No
        }
    }
}

/// Whether all numbers stayed numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Finite {
    /// They did.
    Yes,
    /// Some body was put aside by the engine.
    No,
}
