//! The robot hand as a solver sees it: points that follow landmarks, spheres that take up room.

use std::sync::OnceLock;

use nalgebra::Point3;
use robot::{HandCollision, HandSphere, RobotModel, SelfCollision, spheres};
use spatial::Palm;

use crate::{CompiledHand, HandTable, PostureError, Root};

/// A robot hand with the points that follow landmarks and the spheres that take up room.
#[derive(Debug, Clone)]
pub struct Hand {
    /// Its tree of links.
    pub model: RobotModel,
    /// The hand as the solver knows it. Its points are first [`Hand::points`], then those of the
    /// spheres, then those of the clusters.
    pub compiled: CompiledHand,
    /// The middle of each joint's range.
    pub mid_range: Vec<f64>,
    /// Its size relative to the person's.
    pub scale: f64,
    /// The points that follow landmarks, in the order of the table.
    pub points: Vec<HandPoint>,
    /// Those of them that are on the palm, by index.
    pub palm_points: Vec<usize>,
    /// Positions of the points in the root link's frame with every joint at the middle of its range.
    in_palm: Vec<Point3<f64>>,
    /// Its collision shapes.
    pub collision: HandCollision,
    /// The same against each other, once asked for.
    self_collision: OnceLock<SelfCollision>,
}

/// A point of the robot that follows a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPoint {
    /// The landmark.
    pub keypoint: usize,
    /// Weight of its distance to the landmark.
    pub weight: f64,
    /// Radius of the sphere about it, if it is a fingertip.
    pub tip_radius_m: Option<f64>,
}

impl Hand {
    /// Checks that a robot can be used as a hand and its motions written, whatever its table.
    ///
    /// # Errors
    ///
    /// Fails if it has no joint, a joint whose name cannot be written, or collision shapes far larger
    /// than a hand's.
    pub fn check(model: &RobotModel) -> Result<(), PostureError> {
        if model.dof() == 0 {
            return Err(PostureError::NoJoint);
        }
        // Tables note the joints' names with commas between them.
        let unwritable = |name: &&String| name.is_empty() || name.contains(',');
        if let Some(joint) = model.joint_names().iter().find(unwritable) {
            return Err(PostureError::JointName {
                joint: joint.clone(),
            });
        }
        Ok(spheres::check(model)?)
    }

    /// Prepares a robot that passed [`Hand::check`] for the points of its table.
    ///
    /// # Errors
    ///
    /// Fails if the robot lacks a link that is named, or has more joints than the solver was made
    /// for, or if a keypoint is unknown.
    pub fn new(model: RobotModel, table: &HandTable) -> Result<Self, PostureError> {
        let (mut points, mut places) = (Vec::new(), Vec::new());
        let mut palm_points = Vec::new();
        let mid_range = model.mid_range();
        for (idx, point) in table.points.iter().enumerate() {
            let link = model.require_link(&point.link)?;
            if is_palm(&model, link) {
                palm_points.push(idx);
            }
            points.push(HandPoint {
                keypoint: point.require_keypoint(idx)?,
                weight: point.weight,
                tip_radius_m: point.tip_radius_m,
            });
            places.push((link, Point3::from(point.offset_m)));
        }
        let palm_from_links = model.link_poses::<Palm>(|joint| mid_range[joint]);
        let in_palm = places
            .iter()
            .map(|(link, point)| palm_from_links[*link] * *point)
            .collect();
        let collision = HandCollision::new(&model)?;
        let spheres = collision.spheres();
        places.extend(spheres.map(|sphere| (sphere.link, sphere.sphere.center_in_link)));
        Ok(Self {
            compiled: CompiledHand::new(&model, Root::Free, &places)?,
            mid_range,
            in_palm,
            scale: table.scale,
            points,
            palm_points,
            collision,
            self_collision: OnceLock::new(),
            model,
        })
    }

    /// Returns its collision shapes against each other.
    pub fn self_collision(&self) -> &SelfCollision {
        self.self_collision
            .get_or_init(|| SelfCollision::new(&self.model))
    }

    /// Says whether the points on the palm lie on one line, to half a millimeter: the palm could turn
    /// about it.
    pub fn palm_points_are_collinear(&self) -> bool {
        const NEAR_M: f64 = 5e-4;
        let points = || self.palm_points.iter().map(|&idx| &self.in_palm[idx]);
        let Some(&first) = points().next() else {
            return true;
        };
        let from_first = || points().map(|point| point - first);
        let farthest = from_first().max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let Some(along) = farthest.and_then(|far| far.try_normalize(NEAR_M)) else {
            return true;
        };
        from_first().all(|way| way.cross(&along).norm() < NEAR_M)
    }

    /// Returns the number of a sphere's center among the solver's points.
    pub fn sphere_point(&self, sphere: &HandSphere) -> usize {
        self.points.len() + sphere.number
    }

    /// Returns the least distance of a joint to one of its limits, in radians (meters if prismatic);
    /// a full turn if none is limited.
    pub fn limit_margin(&self, q: &[f64]) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn robots_that_cannot_be_used_are_refused() {
        let urdf = std::fs::read_to_string(fixture::URDF).unwrap();
        assert!(Hand::check(&RobotModel::from_urdf(&urdf).unwrap()).is_ok());
        let refused = |urdf: &str| {
            let model = RobotModel::from_urdf(urdf).unwrap();
            Hand::check(&model).unwrap_err()
        };
        // A file in millimeters: as many spheres would fill the memory.
        let size = "0.0408 0.113 0.095";
        assert!(urdf.contains(size));
        let err = refused(&urdf.replace(size, "40.8 113 95"));
        assert!(err.to_string().contains("`base_link`"), "{err}");
        assert!(err.hint().unwrap().contains("meters"));
        let err = refused(&urdf.replace("joint_13.0", "joint,13"));
        assert!(err.to_string().contains("`joint,13`"), "{err}");
        let err = refused(&urdf.replace("\"revolute\"", "\"fixed\""));
        assert!(err.to_string().contains("no joint"), "{err}");
    }
}
