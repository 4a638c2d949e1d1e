//! The robot hand as retargeting sees it: points that follow landmarks, balls that take up room.

use std::ops::Range;

use nalgebra::Point3;
use robot::RobotModel;

use crate::{
    HandTable, RetargetError,
    balls::{Ball, enclosing, fill, groups},
    solver::{CompiledHand, Root},
};

/// A robot hand with the points that follow landmarks and the balls that take up room.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    /// Its tree of links.
    pub(crate) model: RobotModel,
    /// The hand as the solver knows it. Its points are first [`Hand::points`], then those of the
    /// balls, then those of the clusters.
    pub(crate) compiled: CompiledHand,
    /// The middle of each joint's range.
    pub(crate) mid_range: Vec<f64>,
    /// Its size relative to the person's.
    pub(crate) scale: f64,
    /// The points that follow landmarks, in the order of the table.
    pub(crate) points: Vec<HandPoint>,
    /// Those of them that are on the palm, by index.
    pub(crate) palm_points: Vec<usize>,
    /// Radii of the balls that must stay out of things, in meters, link by link.
    pub(crate) radii_m: Vec<f64>,
    /// Those balls in groups of neighbors.
    pub(crate) clusters: Vec<Cluster>,
}

/// A point of the robot that follows a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HandPoint {
    /// The landmark.
    pub(crate) keypoint: usize,
    /// Weight of its distance to the landmark.
    pub(crate) weight: f64,
    /// Radius of the ball about it, if it is a finger tip.
    pub(crate) tip_radius_m: Option<f64>,
}

/// Neighboring balls of one link, and a ball about them all.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cluster {
    /// Which balls.
    pub(crate) balls: Range<usize>,
    /// Radius of the ball about them, in meters.
    pub(crate) radius_m: f64,
}

impl Hand {
    /// Prepares a robot for the points of its table.
    ///
    /// # Errors
    ///
    /// Fails if the robot lacks a link that is named, or has more joints than the solver was made
    /// for.
    pub(crate) fn new(model: RobotModel, table: &HandTable) -> Result<Self, RetargetError> {
        let (mut points, mut places) = (Vec::new(), Vec::new());
        let mut palm_points = Vec::new();
        for (idx, point) in table.points.iter().enumerate() {
            let link = model.require_link(&point.link)?;
            if is_palm(&model, link) {
                palm_points.push(idx);
            }
            points.push(HandPoint {
                // A table is checked when it is read.
                keypoint: point.keypoint_idx().unwrap_or(0),
                weight: point.weight,
                tip_radius_m: point.tip_radius_m,
            });
            places.push((link, Point3::from(point.offset_m)));
        }
        let (mut clusters, mut radii_m, mut centers) = (Vec::new(), Vec::new(), Vec::new());
        for (idx, link) in model.links().iter().enumerate() {
            let balls: Vec<Ball> = link.collisions.iter().flat_map(fill).collect();
            for group in groups(balls) {
                let Some(around) = enclosing(&group) else {
                    continue;
                };
                let first = radii_m.len();
                radii_m.extend(group.iter().map(|ball| ball.radius_m));
                places.extend(group.iter().map(|ball| (idx, ball.center_in_link)));
                clusters.push(Cluster {
                    balls: first..radii_m.len(),
                    radius_m: around.radius_m,
                });
                centers.push((idx, around.center_in_link));
            }
        }
        places.extend(centers);
        Ok(Self {
            compiled: CompiledHand::new(&model, Root::Free, &places)?,
            mid_range: model.mid_range(),
            scale: table.scale,
            points,
            palm_points,
            radii_m,
            clusters,
            model,
        })
    }

    /// Returns the number of a ball among the solver's points.
    pub(crate) fn ball_point(&self, ball: usize) -> usize {
        self.points.len() + ball
    }

    /// Returns the number of a cluster's center among the solver's points.
    pub(crate) fn cluster_point(&self, cluster: usize) -> usize {
        self.points.len() + self.radii_m.len() + cluster
    }

    /// Returns the least distance of a joint to one of its limits, in radians (meters if prismatic);
    /// a full turn if none is limited.
    pub(crate) fn limit_margin(&self, q: &[f64]) -> f64 {
        q.iter()
            .zip(self.model.joints())
            .map(|(q, joint)| (q - joint.lower).min(joint.upper - q))
            .fold(std::f64::consts::TAU, f64::min)
    }
}

/// Says whether a link is fixed to the root.
fn is_palm(model: &RobotModel, link: usize) -> bool {
    let mut next = Some(link);
    while let Some(link) = next.and_then(|idx| model.links().get(idx)) {
        if link.kind.is_some() {
            return false;
        }
        next = link.parent;
    }
    true
}
