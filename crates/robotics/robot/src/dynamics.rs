//! Forces and motion: inverse dynamics, mass matrix, gravity, energy.
//!
//! Featherstone, *Rigid Body Dynamics Algorithms*, 2008, with the linear part of a spatial vector
//! first, and every quantity in its body's own frame.
//! A joint that mimics another adds what it does to that one's row, times its multiplier: with
//! positions `G q + o` of all joints, torques are `Gᵀ τ` and the mass matrix is `Gᵀ M G`.

use nalgebra::{DMatrix, DVector, Point3, Vector3, Vector6};
use spatial::Pose;

use crate::{
    DynamicsModel, FreeRootState, Link, WrongDof,
    dynamics_model::{SpatialForce, SpatialInertia, SpatialMotion},
};

/// State of motion of the independent joints; each slice holds one number per joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMotion<'a> {
    /// Positions, in radians (meters if prismatic).
    pub q: &'a [f64],
    /// Velocities, in rad/s (m/s).
    pub velocity: &'a [f64],
    /// Accelerations, in rad/s² (m/s²).
    pub acceleration: &'a [f64],
}

/// Forces and torques on a robot, from outside and in its joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Efforts {
    /// Force in N, then torque in Nm, on the root link at its origin, along its axes: the reaction
    /// that holds it if it is held, and the wrench that has to act if it is free.
    pub root: Vector6<f64>,
    /// Torque in Nm (force in N if prismatic) of each independent joint.
    pub joints: DVector<f64>,
}

impl DynamicsModel {
    /// Returns the efforts of a motion of the robot, by the recursive Newton–Euler algorithm
    /// (Featherstone 2008, table 5.1).
    ///
    /// `gravity` is the acceleration of a falling body in the world's frame, in m/s².
    /// Friction is not part of the model, and the rotors of the motors are if
    /// [`DynamicsModel::with_armature`] gave them an inertia.
    ///
    /// # Errors
    ///
    /// Fails if a slice does not hold exactly one number per joint.
    pub fn inverse_dynamics(
        &self,
        root: &FreeRootState,
        motion: &JointMotion<'_>,
        gravity: &Vector3<f64>,
    ) -> Result<Efforts, WrongDof> {
        let (root, of_links) = self.efforts(root, motion, gravity)?;
        let mut joints = DVector::zeros(self.dof);
        let moving = self.all.iter().filter_map(|body| body.joint.as_ref());
        for (joint, effort) in moving.zip(of_links) {
            joints[joint.number] += joint.multiplier * effort;
        }
        Ok(Efforts { root, joints })
    }

    /// Returns the effort in the joint of each moving link, in the order of the links, those that
    /// mimic another's joint too: torque in Nm about the link's own axis (force in N if prismatic).
    ///
    /// [`DynamicsModel::inverse_dynamics`] adds these up where several links move as one.
    ///
    /// # Errors
    ///
    /// Fails if a slice does not hold exactly one number per independent joint.
    pub fn link_efforts(
        &self,
        root: &FreeRootState,
        motion: &JointMotion<'_>,
        gravity: &Vector3<f64>,
    ) -> Result<Vec<f64>, WrongDof> {
        self.efforts(root, motion, gravity)
            .map(|(_, of_links)| of_links)
    }

    /// Returns the efforts on the root, and in the joint of each moving link.
    fn efforts(
        &self,
        root: &FreeRootState,
        motion: &JointMotion<'_>,
        gravity: &Vector3<f64>,
    ) -> Result<(Vector6<f64>, Vec<f64>), WrongDof> {
        let parent_from_bodies = self.parent_from_bodies(motion.q)?;
        self.check(motion.velocity)?;
        self.check(motion.acceleration)?;
        let n = self.all.len();
        let mut velocities = vec![SpatialMotion::zero(); n];
        let mut accelerations = vec![SpatialMotion::zero(); n];
        let mut forces = vec![SpatialForce::zero(); n];
        for (idx, (body, parent_from_body)) in self.all.iter().zip(&parent_from_bodies).enumerate()
        {
            let (velocity, acceleration) = match &body.joint {
                None => {
                    // Gravity is the same as the world's accelerating upward.
                    let mut acceleration = SpatialMotion::from_twist(&root.acceleration);
                    acceleration.linear -= root.world_from_palm.rotation.inverse() * gravity;
                    (SpatialMotion::from_twist(&root.velocity), acceleration)
                }
                Some(joint) => {
                    let unit = joint.unit_motion().times(joint.multiplier);
                    let own = unit.times(motion.velocity[joint.number]);
                    let velocity = velocities[body.parent].in_child(parent_from_body).plus(own);
                    let acceleration = accelerations[body.parent]
                        .in_child(parent_from_body)
                        .plus(unit.times(motion.acceleration[joint.number]))
                        .plus(velocity.cross_motion(&own));
                    (velocity, acceleration)
                }
            };
            let momentum = body.inertia.times(&velocity);
            forces[idx] = body
                .inertia
                .times(&acceleration)
                .plus(velocity.cross_force(&momentum));
            velocities[idx] = velocity;
            accelerations[idx] = acceleration;
        }
        let mut of_links = Vec::with_capacity(n);
        for idx in (0..n).rev() {
            let body = &self.all[idx];
            if let Some(joint) = &body.joint {
                let rotor = joint.multiplier * motion.acceleration[joint.number] * self.armature;
                of_links.push(joint.unit_motion().dot(&forces[idx]) + rotor);
                let on_parent = forces[idx].in_parent(&parent_from_bodies[idx]);
                forces[body.parent] = forces[body.parent].plus(on_parent);
            }
        }
        of_links.reverse();
        let root = forces
            .first()
            .map_or_else(Vector6::zeros, SpatialForce::vector);
        Ok((root, of_links))
    }

    /// Returns the mass matrix of a robot whose root is held: `(dof, dof)`, in kg m² where both
    /// joints turn.
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one number per joint.
    pub fn mass_matrix(&self, q: &[f64]) -> Result<DMatrix<f64>, WrongDof> {
        let whole = self.free_mass_matrix(q)?;
        Ok(whole.view((6, 6), (self.dof, self.dof)).into_owned())
    }

    /// Returns the mass matrix of a robot whose root is free: `(6 + dof, 6 + dof)`, with the root's
    /// twist before the joints. It does not depend on where the root is.
    ///
    /// The composite rigid body algorithm (Featherstone 2008, table 6.2, and §9.4 for the root).
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one number per joint.
    pub fn free_mass_matrix(&self, q: &[f64]) -> Result<DMatrix<f64>, WrongDof> {
        const ROOT: usize = 6;
        let parent_from_bodies = self.parent_from_bodies(q)?;
        let composites = self.composites(&parent_from_bodies);
        let mut matrix = DMatrix::zeros(ROOT + self.dof, ROOT + self.dof);
        let whole = composites
            .first()
            .map_or_else(nalgebra::Matrix6::zeros, SpatialInertia::matrix);
        matrix.view_mut((0, 0), (ROOT, ROOT)).copy_from(&whole);
        for (idx, body) in self.all.iter().enumerate() {
            let Some(joint) = &body.joint else { continue };
            let row = ROOT + joint.number;
            let unit = joint.unit_motion();
            let mut force = composites[idx].times(&unit).times(joint.multiplier);
            matrix[(row, row)] += joint.multiplier * unit.dot(&force);
            matrix[(row, row)] += joint.multiplier.powi(2) * self.armature;
            let mut current = idx;
            while let Some(_joint) = &self.all[current].joint {
                force = force.in_parent(&parent_from_bodies[current]);
                current = self.all[current].parent;
                if let Some(above) = &self.all[current].joint {
                    let column = ROOT + above.number;
                    let entry = above.multiplier * above.unit_motion().dot(&force);
                    // Both entries, which are one and the same if one joint moves both bodies.
                    matrix[(row, column)] += entry;
                    matrix[(column, row)] += entry;
                }
            }
            for (column, entry) in force.vector().iter().enumerate() {
                matrix[(row, column)] += entry;
                matrix[(column, row)] += entry;
            }
        }
        Ok(matrix)
    }

    /// Returns the center of mass of all bodies in the root link's frame, in meters; its origin if
    /// nothing has mass.
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one number per joint.
    pub fn center_of_mass(&self, q: &[f64]) -> Result<Point3<f64>, WrongDof> {
        let composites = self.composites(&self.parent_from_bodies(q)?);
        let center = composites
            .first()
            .filter(|whole| whole.mass > 0.0)
            .map_or_else(Vector3::zeros, |whole| whole.moment / whole.mass);
        Ok(Point3::from(center))
    }

    /// Returns the inertia of each body with all that hangs on it, in its frame.
    fn composites(&self, parent_from_bodies: &[Pose<Link, Link>]) -> Vec<SpatialInertia> {
        let mut composites: Vec<SpatialInertia> =
            self.all.iter().map(|body| body.inertia).collect();
        for idx in (0..composites.len()).rev() {
            let body = &self.all[idx];
            if body.joint.is_some() {
                let in_parent = composites[idx].in_parent(&parent_from_bodies[idx]);
                composites[body.parent].add(&in_parent);
            }
        }
        composites
    }
}
