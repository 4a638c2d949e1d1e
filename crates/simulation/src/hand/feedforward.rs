//! Fingers that are driven along a motion by the torque that it takes.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use robot::{JointMotion, Root};
use spatial::{Pose, Twist};

use super::{DIMENSIONS, Hand, finger_mut};
use crate::{
    desired::Asked,
    precision::{isometry, real},
    world::World,
};

impl Hand {
    /// Sets every finger's torque for the next physics step: what the hand's own inertia takes for the
    /// accelerations asked for, at the positions and velocities that it has, and a spring and a
    /// damper to what is asked for.
    ///
    /// The hand's weight is compensated, as in [`Hand::drive`], and the palm moves at constant
    /// velocity between the jumps that the engine makes without any effect on the fingers.
    pub(crate) fn follow(&self, world: &mut World, asked: &Asked) {
        let states = self.states(world);
        let (q, velocity): (Vec<f64>, Vec<f64>) = states.map(<(f64, f64)>::from).unzip();
        let motion = JointMotion {
            q: &q,
            velocity: &velocity,
            acceleration: &asked.acceleration,
        };
        let Some(palm) = self.palm_mut(world) else {
            return;
        };
        let (linear, angular) = (palm.linvel(), palm.angvel());
        let velocity_of_palm = [
            linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
        ];
        let orientation = isometry(palm.position()).rotation;
        let root = root(&orientation, velocity_of_palm.map(f64::from));
        let torques = match self
            .dynamics
            .link_efforts(&root, &motion, &Vector3::zeros())
        {
            Ok(torques) => torques,
            Err(err) => unreachable!("the script was checked against the hand: {err}"),
        };
        for (drive, torque) in self.drives.iter().zip(torques) {
            let (q_asked, speed_asked) = (asked.q[drive.joint], asked.velocity[drive.joint]);
            let Some((multibody, place)) = finger_mut(&mut world.multibodies, drive.body) else {
                continue;
            };
            let speed_asked = drive.multiplier * real(speed_asked);
            let ahead = drive.controller.ahead(real(torque), speed_asked);
            drive.apply(multibody, place, q_asked, ahead);
        }
    }
}

/// Returns the palm as a root that keeps its velocity (linear, then angular, along the world's axes).
fn root(orientation: &UnitQuaternion<f64>, palm: [f64; DIMENSIONS]) -> Root {
    let into_palm = orientation.inverse();
    let [x, y, z, a, b, c] = palm;
    let linear = into_palm * Vector3::new(x, y, z);
    let angular = into_palm * Vector3::new(a, b, c);
    // Along the turning axes of the palm, a constant velocity turns the other way.
    let turning = -angular.cross(&linear);
    Root {
        world_from_palm: Pose::new(Isometry3::from_parts(
            nalgebra::Translation3::identity(),
            *orientation,
        )),
        velocity: Twist::new(linear, angular),
        acceleration: Twist::new(turning, Vector3::zeros()),
    }
}
