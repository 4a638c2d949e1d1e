//! Forward kinematics: the poses of the links.

use nalgebra::{Translation3, UnitQuaternion};
use spatial::Pose;

use crate::{JointKind, Link, RobotModel, WrongDof};

impl RobotModel {
    /// Returns the pose of each link in the frame of the root link, a hand's palm or an arm's base,
    /// in the order of the links.
    ///
    /// `q` holds one position per joint. Each pose is its parent's, times the joint's transform
    /// (Lynch and Park, *Modern Robotics*, 2017, §4.2). Limits are not checked.
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one position per joint.
    pub fn forward_kinematics<Root>(&self, q: &[f64]) -> Result<Vec<Pose<Root, Link>>, WrongDof> {
        if q.len() != self.dof() {
            return Err(WrongDof {
                expected: self.dof(),
                found: q.len(),
            });
        }
        Ok(self.link_poses(|joint| q[joint]))
    }

    /// Returns the poses of [`RobotModel::forward_kinematics`]; `position` gives that of the joint of
    /// each index of [`RobotModel::joints`].
    ///
    /// It cannot fail, as it asks for every position that it needs: for positions that follow from the
    /// joints themselves.
    pub fn link_poses<Root>(&self, position: impl Fn(usize) -> f64) -> Vec<Pose<Root, Link>> {
        let mut root_from_links: Vec<Pose<Root, Link>> = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let position = link.joint.map(&position);
            let parent_from_link = parent_from_link(link, position);
            let parent = link.parent.and_then(|parent| root_from_links.get(parent));
            root_from_links.push(match parent {
                Some(root_from_parent) => *root_from_parent * parent_from_link,
                None => parent_from_link.reinterpret(),
            });
        }
        root_from_links
    }
}

/// Returns a link's pose in its parent's frame; `position` is that of the joint that moves it.
fn parent_from_link(link: &Link, position: Option<f64>) -> Pose<Link, Link> {
    let (Some(kind), Some(position)) = (link.kind, position) else {
        return link.parent_from_joint;
    };
    let position = link.multiplier * position + link.offset;
    Pose::new(match kind {
        JointKind::Revolute | JointKind::Continuous => {
            *link.parent_from_joint * UnitQuaternion::from_axis_angle(&link.axis, position)
        }
        JointKind::Prismatic => {
            *link.parent_from_joint * Translation3::from(link.axis.into_inner() * position)
        }
    })
}
