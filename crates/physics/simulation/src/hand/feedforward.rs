//! Fingers that are driven along a motion by its velocity, and by the torque that it takes.

use nalgebra::{UnitQuaternion, Vector3};
use robot::{FreeRootState, JointMotion};
use spatial::{Palm, Pose, Twist};

use super::{HandBodies, finger_mut};
use crate::{
    desired::DesiredStep,
    units::{pose_from_engine, real, vector_in_meters},
    world::World,
};

impl HandBodies {
    /// Sets every finger's torque for the next physics step: a spring and a damper to the desired motion, and, where
    /// its accelerations are known, their inverse dynamics at the measured positions and velocities.
    ///
    /// The hand's weight is compensated, as in [`HandBodies::drive`], and the palm moves at constant
    /// velocity between the jumps that the engine makes without any effect on the fingers.
    pub(crate) fn follow(&self, world: &mut World, desired: &DesiredStep) {
        let torques = match &desired.acceleration {
            Some(acceleration) => self.inverse_dynamics(world, acceleration),
            None => vec![0.0; self.drives.len()],
        };
        for (drive, torque) in self.drives.iter().zip(torques) {
            let (q, speed) = (desired.q[drive.joint], desired.velocity[drive.joint]);
            let Some((multibody, address)) = finger_mut(&mut world.multibodies, drive.body) else {
                continue;
            };
            let speed = drive.multiplier * real(speed);
            let torque = real(torque / drive.units);
            let ahead = drive.controller.ahead(torque, speed);
            drive.apply(multibody, address, q, ahead);
        }
    }

    /// Returns the torque of each drive (Nm or N) for these accelerations of the joints; none without a palm.
    fn inverse_dynamics(&self, world: &mut World, acceleration: &[f64]) -> Vec<f64> {
        let states = self.states(world);
        let (q, velocity): (Vec<f64>, Vec<f64>) = states.map(<(f64, f64)>::from).unzip();
        let motion = JointMotion {
            q: &q,
            velocity: &velocity,
            acceleration,
        };
        let Some(palm) = self.palm_mut(world) else {
            return Vec::new();
        };
        let velocity_of_palm = Twist::new(
            vector_in_meters(palm.linvel()),
            Vector3::from(palm.angvel().to_array().map(f64::from)),
        );
        let engine_from_palm = pose_from_engine::<Palm>(palm.position());
        let root = root(engine_from_palm.rotation, &velocity_of_palm);
        match self
            .dynamics
            .link_efforts(&root, &motion, &Vector3::zeros())
        {
            Ok(torques) => torques,
            Err(err) => unreachable!("the script was checked against the hand: {err}"),
        }
    }
}

/// Returns the palm as a root that keeps its velocity, along the world's axes, wherever it is.
fn root(orientation: UnitQuaternion<f64>, velocity: &Twist<spatial::World>) -> FreeRootState {
    let world_from_palm = Pose::from_parts([0.0; 3], orientation);
    let velocity = velocity.expressed_in(&world_from_palm.inverse());
    // Along the turning axes of the palm, a constant velocity turns the other way.
    let turning = -velocity.angular.cross(&velocity.linear);
    FreeRootState {
        world_from_palm,
        velocity,
        acceleration: Twist::new(turning, Vector3::zeros()),
    }
}
