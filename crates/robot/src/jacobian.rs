//! How points of the robot move with its joints, and with its root.

use nalgebra::{DMatrix, Matrix3xX, Matrix6xX, Point3, Vector3};
use spatial::{Palm, Pose, World};

use crate::{JointKind, Link, RobotModel};

/// A joint on the way from a link to the root, where it now is.
struct Step {
    /// Which independent joint moves it.
    joint: usize,
    is_turning: bool,
    /// Its own position per position of that joint.
    multiplier: f64,
    axis_in_root: Vector3<f64>,
    origin_in_root: Vector3<f64>,
}

impl Step {
    /// Returns how a point in the root's frame moves with the independent joint.
    fn column(&self, point_in_root: &Point3<f64>) -> Vector3<f64> {
        let per_own = if self.is_turning {
            let arm = point_in_root.coords - self.origin_in_root;
            self.axis_in_root.cross(&arm)
        } else {
            self.axis_in_root
        };
        per_own * self.multiplier
    }

    /// Returns how fast what the joint moves turns with the independent joint.
    fn turning(&self) -> Vector3<f64> {
        if self.is_turning {
            self.axis_in_root * self.multiplier
        } else {
            Vector3::zeros()
        }
    }
}

impl RobotModel {
    /// Returns the derivative of a point fixed to a link by the joint positions, in the root's
    /// frame: `(3, dof)`, meters per radian (or per meter).
    ///
    /// `root_from_links` comes from [`RobotModel::forward_kinematics`] and the point is given where
    /// it then is, in the root's frame. Column by column this is the geometric Jacobian
    /// (Lynch and Park, *Modern Robotics*, 2017, §5.1).
    /// A link or pose that does not exist moves with no joint.
    pub fn point_jacobian<Root>(
        &self,
        root_from_links: &[Pose<Root, Link>],
        link: usize,
        point_in_root: &Point3<f64>,
    ) -> Matrix3xX<f64> {
        let mut jacobian = Matrix3xX::zeros(self.dof());
        for step in self.steps(root_from_links, link) {
            let mut sum = jacobian.column_mut(step.joint);
            sum += step.column(point_in_root);
        }
        jacobian
    }

    /// Returns how a link moves with the joint positions, in the root's frame: `(6, dof)`, the
    /// velocity of a point fixed to it in meters, then its angular velocity in radians, per radian
    /// (or per meter).
    ///
    /// Arguments are those of [`RobotModel::point_jacobian`].
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

    /// Returns how a link moves with the root's twist and the joint positions, in the world's
    /// frame: `(6, 6 + dof)`, rows as those of [`RobotModel::geometric_jacobian`], columns the
    /// twist of [`crate::Root`] and then the joints.
    ///
    /// The point is given in the frame of the root, the palm.
    pub fn free_jacobian(
        &self,
        world_from_palm: &Pose<World, Palm>,
        palm_from_links: &[Pose<Palm, Link>],
        link: usize,
        point_in_palm: &Point3<f64>,
    ) -> Matrix6xX<f64> {
        const ROOT: usize = 6;
        let rotation = world_from_palm.rotation.to_rotation_matrix();
        let in_palm = self.geometric_jacobian(palm_from_links, link, point_in_palm);
        let mut jacobian = Matrix6xX::zeros(ROOT + self.dof());
        let about = -(rotation.matrix() * point_in_palm.coords.cross_matrix());
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(rotation.matrix());
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&about);
        jacobian
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(rotation.matrix());
        for half in [0, 3] {
            let turned = rotation.matrix() * in_palm.fixed_rows::<3>(half);
            jacobian
                .view_mut((half, ROOT), (3, self.dof()))
                .copy_from(&turned);
        }
        jacobian
    }

    /// Returns the second derivatives of a point fixed to a link by the joint positions, in the
    /// root's frame: one symmetric `(dof, dof)` matrix for each of its coordinates, meters per
    /// radian².
    ///
    /// Arguments are those of [`RobotModel::point_jacobian`]. A joint that turns carries along what
    /// every joint beyond it does: the derivative of that one's column is the axis times it
    /// (Lynch and Park, *Modern Robotics*, 2017, §5.1.4).
    pub fn point_hessian<Root>(
        &self,
        root_from_links: &[Pose<Root, Link>],
        link: usize,
        point_in_root: &Point3<f64>,
    ) -> [DMatrix<f64>; 3] {
        let mut hessian = [(); 3].map(|()| DMatrix::zeros(self.dof(), self.dof()));
        // From the link to the root: the later of two carries along the earlier.
        let steps: Vec<Step> = self.steps(root_from_links, link).collect();
        for (idx, carried) in steps.iter().enumerate() {
            let column = carried.column(point_in_root);
            for carrier in steps.iter().skip(idx) {
                let second = carrier.turning().cross(&column);
                let is_same = std::ptr::eq(carrier, carried);
                for (matrix, &entry) in hessian.iter_mut().zip(second.iter()) {
                    matrix[(carrier.joint, carried.joint)] += entry;
                    if !is_same {
                        matrix[(carried.joint, carrier.joint)] += entry;
                    }
                }
            }
        }
        hessian
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
