//! A root that moves freely: its pose, and small motions of it, without angles that can lock.

use nalgebra::UnitQuaternion;
use spatial::{Palm, Pose, Twist, World};

/// Below this angle in radians the series are more exact than the quotients.
const SMALL_RAD: f64 = 1e-3;

/// State of the root link: its pose, velocity and acceleration.
///
/// A twist is that of the root link's own origin, along the root link's own axes. A twist added for
/// a time moves the root to `world_from_palm * pose_from_twist(twist * time)`. This is the
/// convention of Pinocchio's free flyer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeRootState {
    /// Pose of the root link in the world.
    pub world_from_palm: Pose<World, Palm>,
    /// Its velocity.
    pub velocity: Twist<Palm>,
    /// Derivative of the velocity's six numbers (a spatial acceleration).
    pub acceleration: Twist<Palm>,
}

impl FreeRootState {
    /// Returns a root that is held in this pose.
    pub fn still(world_from_palm: Pose<World, Palm>) -> Self {
        Self {
            world_from_palm,
            velocity: Twist::zero(),
            acceleration: Twist::zero(),
        }
    }

    /// Returns the root's pose after it has kept its twist for a time in seconds.
    pub fn after(&self, time_s: f64) -> Pose<World, Palm> {
        self.world_from_palm * pose_from_twist(&(self.velocity * time_s))
    }
}

/// Returns the pose to which a twist leads in one second, from the identity.
///
/// Lynch and Park, *Modern Robotics*, 2017, §3.3.3, proposition 3.25.
pub fn pose_from_twist(twist: &Twist<Palm>) -> Pose<Palm, Palm> {
    let (linear, angular) = (twist.linear, twist.angular);
    let angle_sq = angular.norm_squared();
    let angle = angle_sq.sqrt();
    // (1 - cos θ) / θ² and (θ - sin θ) / θ³.
    let (b, c) = if angle < SMALL_RAD {
        (
            0.5 - angle_sq / 24.0 * (1.0 - angle_sq / 30.0),
            1.0 / 6.0 - angle_sq / 120.0 * (1.0 - angle_sq / 42.0),
        )
    } else {
        (
            (1.0 - angle.cos()) / angle_sq,
            (angle - angle.sin()) / (angle_sq * angle),
        )
    };
    let once = angular.cross(&linear);
    let along = linear + once * b + angular.cross(&once) * c;
    Pose::from_parts(along, UnitQuaternion::from_scaled_axis(angular))
}
