//! Fingers that are driven along a motion by the torque that it takes.

use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector6};
use robot::{JointMotion, Root};

use super::{DIMENSIONS, Hand, coordinate};
use crate::{desired::Asked, precision::real, world::World};

impl Hand {
    /// Sets every finger's torque for the next physics step: what the hand's own inertia takes for the
    /// accelerations asked for, at the positions and velocities that it has, and a spring and a
    /// damper to what is asked for.
    ///
    /// The hand's weight is compensated, as in [`Hand::drive`], and the palm moves at constant
    /// velocity between the jumps that the engine makes without any effect on the fingers.
    pub(crate) fn follow(&self, world: &mut World, asked: &Asked) {
        let Some(multibody) = world.multibodies.get_multibody_mut(self.multibody) else {
            return;
        };
        let states = || {
            let drives = self.joints.iter().filter_map(|&idx| self.drives.get(idx));
            drives.map(|drive| {
                let q = coordinate(multibody, drive);
                let speed = multibody.generalized_velocity()[drive.coordinate];
                (f64::from(q), f64::from(speed))
            })
        };
        let q: Vec<f64> = states().map(|(q, _)| q).collect();
        let velocity: Vec<f64> = states().map(|(_, velocity)| velocity).collect();
        let motion = JointMotion {
            q: &q,
            velocity: &velocity,
            acceleration: &asked.acceleration,
        };
        let mut palm = [0.0; DIMENSIONS];
        for (number, speed) in palm.iter_mut().zip(multibody.generalized_velocity().iter()) {
            *number = f64::from(*speed);
        }
        let orientation = multibody
            .link(self.palm)
            .map_or_else(UnitQuaternion::identity, |link| {
                crate::precision::isometry(link.local_to_world()).rotation
            });
        let root = root(&orientation, palm);
        // The hand was built of the same model: the numbers of joints agree.
        let torques = self
            .dynamics
            .link_efforts(&root, &motion, &Vector3::zeros())
            .unwrap_or_default();
        for (drive, torque) in self.drives.iter().zip(torques) {
            let (Some(q_asked), Some(speed_asked)) =
                (asked.q.get(drive.joint), asked.velocity.get(drive.joint))
            else {
                continue;
            };
            let spring = drive.controller.spring(
                drive.multiplier * real(*q_asked) + drive.offset,
                drive
                    .controller
                    .ahead(real(torque), drive.multiplier * real(*speed_asked)),
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
        world_from_root: Isometry3::from_parts(nalgebra::Translation3::identity(), *orientation),
        velocity: Vector6::new(
            linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
        ),
        acceleration: Vector6::new(turning.x, turning.y, turning.z, 0.0, 0.0, 0.0),
    }
}
