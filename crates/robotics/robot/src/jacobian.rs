//! Geometric Jacobian: velocities of the robot's points per joint velocity.

use nalgebra::{Matrix6xX, Point3, Vector3};
use spatial::Pose;

use crate::{JointKind, Link, RobotModel};

/// A joint on the path from a link to the root, where it now is.
struct Step {
    /// Index of the independent joint that moves it.
    joint: usize,
    is_turning: bool,
    /// Its own position per position of that joint.
    multiplier: f64,
    axis_in_root: Vector3<f64>,
    origin_in_root: Vector3<f64>,
}

impl Step {
    /// Returns the velocity of a point in the root's frame per velocity of the independent joint.
    fn column(&self, point_in_root: &Point3<f64>) -> Vector3<f64> {
        let per_own = if self.is_turning {
            let arm = point_in_root.coords - self.origin_in_root;
            self.axis_in_root.cross(&arm)
        } else {
            self.axis_in_root
        };
        per_own * self.multiplier
    }

    /// Returns the angular velocity of the moved links per velocity of the independent joint.
    fn turning(&self) -> Vector3<f64> {
        if self.is_turning {
            self.axis_in_root * self.multiplier
        } else {
            Vector3::zeros()
        }
    }
}

impl RobotModel {
    /// Returns the geometric Jacobian of a link, in the root's frame: `(6, dof)`, the velocity of a
    /// point fixed to it in meters, then its angular velocity in radians, per radian (or per meter)
    /// of each joint (Lynch and Park, *Modern Robotics*, 2017, §5.1).
    ///
    /// `root_from_links` comes from [`RobotModel::forward_kinematics`] and the point is given where
    /// it then is, in the root's frame. A link or pose that does not exist moves with no joint.
    pub fn geometric_jacobian<Root>(
        &self,
        root_from_links: &[Pose<Root, Link>],
        link: usize,
        point_in_root: &Point3<f64>,
    ) -> Matrix6xX<f64> {
        let mut jacobian = Matrix6xX::zeros(self.dof());
        for step in self.steps(root_from_links, link) {
            let mut linear = jacobian.fixed_view_mut::<3, 1>(0, step.joint);
            linear += step.column(point_in_root);
            let mut angular = jacobian.fixed_view_mut::<3, 1>(3, step.joint);
            angular += step.turning();
        }
        jacobian
    }

    /// Calls `found` with each joint that moves a link and the velocity of a point fixed to it, in meters per radian (or
    /// per meter), as the columns of [`RobotModel::geometric_jacobian`].
    pub(crate) fn each_joint_velocity<Root>(
        &self,
        root_from_links: &[Pose<Root, Link>],
        link: usize,
        point_in_root: &Point3<f64>,
        mut found: impl FnMut(usize, Vector3<f64>),
    ) {
        for step in self.steps(root_from_links, link) {
            found(step.joint, step.column(point_in_root));
        }
    }

    /// Returns the moving joints from a link to the root.
    fn steps<Root>(
        &self,
        root_from_links: &[Pose<Root, Link>],
        link: usize,
    ) -> impl Iterator<Item = Step> {
        let mut next = Some(link);
        std::iter::from_fn(move || {
            loop {
                let idx = next?;
                let (link, root_from_link) = (self.links.get(idx)?, root_from_links.get(idx)?);
                next = link.parent;
                if let (Some(joint), Some(kind)) = (link.joint, link.kind) {
                    return Some(Step {
                        joint,
                        is_turning: kind != JointKind::Prismatic,
                        multiplier: link.multiplier,
                        axis_in_root: root_from_link.rotation * link.axis.into_inner(),
                        origin_in_root: root_from_link.translation.vector,
                    });
                }
            }
        })
    }
}
