//! Where the links are.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::{JointKind, Link, RobotModel, WrongDof};

impl RobotModel {
    /// Returns the pose of each link in the palm's frame, in the order of the links.
    ///
    /// `q` holds one position per joint. Each pose is its parent's, times the joint's transform
    /// (Lynch and Park, *Modern Robotics*, 2017, §4.2). Limits are not checked.
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one position per joint.
    pub fn forward_kinematics(&self, q: &[f64]) -> Result<Vec<Isometry3<f64>>, WrongDof> {
        if q.len() != self.dof() {
            return Err(WrongDof {
                expected: self.dof(),
                found: q.len(),
            });
        }
        Ok(self.link_poses(|joint| q[joint]))
    }

    /// Returns the pose of each link in the palm's frame, in the order of the links; `position` gives
    /// that of the joint of each index of [`RobotModel::joints`].
    ///
    /// It cannot fail, as it asks for every position that it needs: for positions that follow from the
    /// joints themselves. [`RobotModel::forward_kinematics`] takes vectors.
    pub fn link_poses(&self, position: impl Fn(usize) -> f64) -> Vec<Isometry3<f64>> {
        let mut palm_from_links: Vec<Isometry3<f64>> = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let position = link.joint.map(&position);
            let parent_from_link = parent_from_link(link, position);
            let palm_from_link = match link.parent.and_then(|parent| palm_from_links.get(parent)) {
                Some(palm_from_parent) => palm_from_parent * parent_from_link,
                None => parent_from_link,
            };
            palm_from_links.push(palm_from_link);
        }
        palm_from_links
    }
}

/// Returns a link's pose in its parent's frame; `position` is that of the joint that moves it.
fn parent_from_link(link: &Link, position: Option<f64>) -> Isometry3<f64> {
    let (Some(kind), Some(position)) = (link.kind, position) else {
        return link.parent_from_joint;
    };
    let position = link.multiplier * position + link.offset;
    match kind {
        JointKind::Revolute | JointKind::Continuous => {
            link.parent_from_joint * UnitQuaternion::from_axis_angle(&link.axis, position)
        }
        JointKind::Prismatic => {
            link.parent_from_joint * Translation3::from(link.axis.into_inner() * position)
        }
    }
}
