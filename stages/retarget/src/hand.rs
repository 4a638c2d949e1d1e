//! The robot hand as retargeting sees it: points that follow landmarks, balls that take up room.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use robot::{JointKind, RobotError, RobotModel};

use crate::{
    HandTable,
    balls::{Ball, fill},
};

/// Reach of joints without limits about 0, in radians.
const CONTINUOUS_REACH_RAD: f64 = 100.0 * std::f64::consts::TAU;

/// A robot hand with the points that follow landmarks and the balls that take up room.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    /// Its tree of links.
    pub(crate) model: RobotModel,
    /// Its size relative to the person's.
    pub(crate) scale: f64,
    /// The points that follow landmarks, in the order of the table.
    pub(crate) points: Vec<HandPoint>,
    /// The balls that must stay out of things.
    pub(crate) balls: Vec<Ball>,
    /// Least position of each joint.
    pub(crate) lower: Vec<f64>,
    /// Greatest position of each joint.
    pub(crate) upper: Vec<f64>,
}

/// A point of the robot that follows a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HandPoint {
    /// The landmark.
    pub(crate) keypoint: usize,
    /// The link.
    pub(crate) link: usize,
    /// The point in the link's frame, in meters.
    pub(crate) point_in_link: Point3<f64>,
    /// Weight of its distance to the landmark.
    pub(crate) weight: f64,
    /// Radius of the ball about it, if it is a finger tip.
    pub(crate) tip_radius_m: Option<f64>,
}

impl Hand {
    /// Prepares a robot for the points of its table.
    ///
    /// # Errors
    ///
    /// Fails if the robot lacks a link that is named.
    pub(crate) fn new(model: RobotModel, table: &HandTable) -> Result<Self, RobotError> {
        let mut points = Vec::with_capacity(table.points.len());
        for point in &table.points {
            points.push(HandPoint {
                // A table is checked when it is read.
                keypoint: point.keypoint_idx().unwrap_or(0),
                link: model.require_link(&point.link)?,
                point_in_link: Point3::from(point.offset_m),
                weight: point.weight,
                tip_radius_m: point.tip_radius_m,
            });
        }
        let balls = model
            .links()
            .iter()
            .enumerate()
            .flat_map(|(idx, link)| link.collisions.iter().flat_map(move |c| fill(idx, c)))
            .collect();
        let limit = |joint: &robot::Joint, bound: f64| match joint.kind {
            JointKind::Continuous => CONTINUOUS_REACH_RAD.copysign(bound),
            JointKind::Revolute | JointKind::Prismatic => bound,
        };
        Ok(Self {
            scale: table.scale,
            points,
            balls,
            lower: model.joints().iter().map(|j| limit(j, j.lower)).collect(),
            upper: model.joints().iter().map(|j| limit(j, j.upper)).collect(),
            model,
        })
    }

    /// Returns the least distance of a joint to one of its limits, in radians (meters if prismatic);
    /// a full turn if none is limited.
    pub(crate) fn limit_margin(&self, q: &[f64]) -> f64 {
        q.iter()
            .zip(self.lower.iter().zip(&self.upper))
            .map(|(q, (lower, upper))| (q - lower).min(upper - q))
            .fold(std::f64::consts::TAU, f64::min)
    }

    /// Returns where every link is in the object frame.
    pub(crate) fn object_from_links(&self, posture: &Posture) -> Vec<Isometry3<f64>> {
        let mut links = self
            .model
            .forward_kinematics(&posture.q)
            .unwrap_or_else(|err| unreachable!("postures are made for this hand: {err}"));
        for link in &mut links {
            *link = posture.object_from_palm * *link;
        }
        links
    }
}

/// Where the palm is and how the joints stand.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Posture {
    /// Pose of the palm in the object frame.
    pub(crate) object_from_palm: Isometry3<f64>,
    /// Joint positions in radians.
    pub(crate) q: Vec<f64>,
}

impl Posture {
    /// Returns the posture moved by an increment: three numbers move the palm along the object's
    /// axes (m), three turn it about them in place (rad), the rest go to the joints, which stay
    /// between `lower` and `upper`.
    ///
    /// The turn is the exponential map at the palm's orientation, so that no orientation is special.
    pub(crate) fn moved(&self, step: &[f64], lower: &[f64], upper: &[f64]) -> Self {
        let (root, joints) = step.split_at(step.len().min(6));
        let part = |at: usize| {
            let number = |i: usize| root.get(at + i).copied().unwrap_or(0.0);
            Vector3::new(number(0), number(1), number(2))
        };
        let old = &self.object_from_palm;
        let rotation = UnitQuaternion::new(part(3)) * old.rotation;
        let object_from_palm = Isometry3::from_parts(
            Translation3::from(old.translation.vector + part(0)),
            UnitQuaternion::new_normalize(rotation.into_inner()),
        );
        let q = self
            .q
            .iter()
            .zip(joints)
            .zip(lower.iter().zip(upper))
            .map(|((&q, &change), (&lower, &upper))| (q + change).clamp(lower, upper))
            .collect();
        Self {
            object_from_palm,
            q,
        }
    }
}
