//! How points of the hand move with its joints.

use nalgebra::{Isometry3, Matrix3xX, Point3};

use crate::{JointKind, RobotModel};

impl RobotModel {
    /// Returns the derivative of a point fixed to a link by the joint positions, in the palm's
    /// frame: `(3, dof)`, meters per radian (or per meter).
    ///
    /// `palm_from_links` comes from [`RobotModel::forward_kinematics`] and the point is given where
    /// it then is, in the palm's frame. Column by column this is the geometric Jacobian
    /// (Lynch and Park, *Modern Robotics*, 2017, §5.1).
    /// A link or pose that does not exist moves with no joint.
    pub fn point_jacobian(
        &self,
        palm_from_links: &[Isometry3<f64>],
        link: usize,
        point_in_palm: &Point3<f64>,
    ) -> Matrix3xX<f64> {
        let mut jacobian = Matrix3xX::zeros(self.dof());
        self.visit_point_jacobian(palm_from_links, link, point_in_palm, |joint, column| {
            let mut sum = jacobian.column_mut(joint);
            sum += column;
        });
        jacobian
    }

    /// Calls `visit` with each joint that moves the point and the point's derivative by it, as
    /// [`RobotModel::point_jacobian`] but without the columns that are zero. A joint that others
    /// mimic is visited once for each of them: add up.
    pub fn visit_point_jacobian(
        &self,
        palm_from_links: &[Isometry3<f64>],
        link: usize,
        point_in_palm: &Point3<f64>,
        mut visit: impl FnMut(usize, nalgebra::Vector3<f64>),
    ) {
        let mut next = Some(link);
        while let Some(idx) = next {
            let (Some(link), Some(palm_from_link)) =
                (self.links.get(idx), palm_from_links.get(idx))
            else {
                return;
            };
            if let (Some(joint), Some(kind)) = (link.joint, link.kind) {
                let axis_in_palm = palm_from_link.rotation * link.axis.into_inner();
                let column = match kind {
                    JointKind::Revolute | JointKind::Continuous => {
                        let arm = point_in_palm.coords - palm_from_link.translation.vector;
                        axis_in_palm.cross(&arm)
                    }
                    JointKind::Prismatic => axis_in_palm,
                };
                visit(joint, column * link.multiplier);
            }
            next = link.parent;
        }
    }
}
