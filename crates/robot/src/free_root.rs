//! A root that moves freely: its pose, and small motions of it, without angles that can lock.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, Vector6};

/// Below this angle in radians the series are more exact than the quotients.
const SMALL_RAD: f64 = 1e-3;

/// How the root link is held or moves.
///
/// A twist has the linear part first and is that of the root link's own origin, along the root
/// link's own axes: m/s and rad/s. A twist added for a time moves the root to
/// `world_from_root * pose_from_twist(twist * time)`. This is the convention of Pinocchio's free flyer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Root {
    /// Pose of the root link in the world.
    pub world_from_root: Isometry3<f64>,
    /// Twist, in m/s and rad/s.
    pub velocity: Vector6<f64>,
    /// Derivative of the twist's six numbers, in m/s² and rad/s² (a spatial acceleration).
    pub acceleration: Vector6<f64>,
}

impl Root {
    /// Returns a root that is held in this pose.
    pub fn still(world_from_root: Isometry3<f64>) -> Self {
        Self {
            world_from_root,
            velocity: Vector6::zeros(),
            acceleration: Vector6::zeros(),
        }
    }

    /// Returns the root's pose after it has kept its twist for a time in seconds.
    pub fn after(&self, time_s: f64) -> Isometry3<f64> {
        self.world_from_root * pose_from_twist(&(self.velocity * time_s))
    }
}

/// Returns the pose to which a twist (meters and radians, linear part first) leads in one unit of
/// time, from the identity.
///
/// Lynch and Park, *Modern Robotics*, 2017, §3.3.3, proposition 3.25.
pub fn pose_from_twist(twist: &Vector6<f64>) -> Isometry3<f64> {
    let linear: Vector3<f64> = twist.fixed_rows::<3>(0).into_owned();
    let angular: Vector3<f64> = twist.fixed_rows::<3>(3).into_owned();
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
    Isometry3::from_parts(
        Translation3::from(along),
        UnitQuaternion::from_scaled_axis(angular),
    )
}

/// Returns the twist (meters and radians, linear part first) that leads from the identity to a pose
/// in one unit of time, turning by at most π: the inverse of [`pose_from_twist`].
///
/// Lynch and Park, *Modern Robotics*, 2017, §3.3.3, equation 3.92.
pub fn twist_from_pose(pose: &Isometry3<f64>) -> Vector6<f64> {
    let angular = pose.rotation.scaled_axis();
    let angle_sq = angular.norm_squared();
    let angle = angle_sq.sqrt();
    // 1/θ² - cot(θ/2) / (2 θ).
    let c = if angle < SMALL_RAD {
        1.0 / 12.0 + angle_sq / 720.0
    } else {
        1.0 / angle_sq - 0.5 / (angle * (0.5 * angle).tan())
    };
    let translation = pose.translation.vector;
    let once = angular.cross(&translation);
    let linear = translation - once * 0.5 + angular.cross(&once) * c;
    let mut twist = Vector6::zeros();
    twist.fixed_rows_mut::<3>(0).copy_from(&linear);
    twist.fixed_rows_mut::<3>(3).copy_from(&angular);
    twist
}
