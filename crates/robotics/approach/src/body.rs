//! Distances of a hand from an object and a table, link by link.

use motion::HandState;
use nalgebra::{Point3, Vector3};
use posture::Environment;
use robot::{Clearance, HandCollision, HandSphere, Link, RobotModel};
use spatial::{Object, Palm, Pose};

use crate::{ApproachError, HandAxes};

/// A hand whose collision shapes are filled with spheres, and which joints bend its fingers.
#[derive(Debug, Clone)]
pub struct HandBody {
    pub(crate) model: RobotModel,
    pub(crate) collision: HandCollision,
    axes: HandAxes,
    flexion: Vec<usize>,
    grasp_q: Vec<f64>,
    /// For each joint and link, whether the joint moves the link.
    moves: Vec<Vec<bool>>,
}

/// A hand at a pose: the poses of its palm and links.
#[derive(Debug, Clone)]
pub struct PlacedHand {
    object_from_palm: Pose<Object, Palm>,
    object_from_links: Vec<Pose<Object, Link>>,
}

/// A point where a link touches the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// The link, by its number among the model's.
    pub link: usize,
    /// On the link's surface, object frame, in meters.
    pub point_in_object: Point3<f64>,
    /// The object's outward normal there.
    pub normal_in_object: Vector3<f64>,
    /// Distance from the object's surface, in meters, negative inside.
    pub gap_m: f64,
}

impl PlacedHand {
    /// Returns the pose of a link in the object's frame; the palm's for a link that does not exist.
    pub fn object_from_link(&self, link: usize) -> Pose<Object, Link> {
        let found = self.object_from_links.get(link);
        found.map_or(self.object_from_palm.reinterpret(), |pose| *pose)
    }
}

impl HandBody {
    /// Fills a hand's shapes with spheres; `flexion` names the joints that bend the fingers with growing positions,
    /// `grasp_q` is a typical grasp, such as the mean of retargeted ones.
    ///
    /// # Errors
    ///
    /// Fails if the hand has no thumb or no finger beside it, lacks a joint that is named, has shapes far larger than
    /// a hand's, or another number of joints than the grasp.
    pub fn new(
        model: RobotModel,
        flexion: &[impl AsRef<str>],
        grasp_q: Vec<f64>,
    ) -> Result<Self, ApproachError> {
        let collision = HandCollision::new(&model)?;
        let flexion = model.require_joints(flexion)?;
        let links = model.links();
        let moves = (0..model.dof()).map(|joint| {
            let moved_by = |link: usize| {
                let mut next = Some(link);
                std::iter::from_fn(|| {
                    let link = links.get(next?)?;
                    next = link.parent;
                    Some(link.joint == Some(joint) && link.kind.is_some())
                })
                .any(|is| is)
            };
            (0..links.len()).map(moved_by).collect()
        });
        Ok(Self {
            axes: HandAxes::of(&model, &grasp_q)?,
            grasp_q,
            collision,
            flexion,
            moves: moves.collect(),
            model,
        })
    }

    /// Returns the hand's tree.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// Returns the grasp axes of the hand.
    pub fn axes(&self) -> &HandAxes {
        &self.axes
    }

    /// Returns the joints that bend the fingers, by number.
    pub fn flexion(&self) -> &[usize] {
        &self.flexion
    }

    /// Returns joint positions of an open hand: the fingers straight, and the joints that spread them or oppose the
    /// thumb as in the typical grasp.
    pub fn open(&self) -> Vec<f64> {
        let joints = self.model.joints().iter().enumerate();
        let position = |(idx, joint): (usize, &robot::Joint)| {
            if self.flexion.contains(&idx) {
                joint.nearest_zero()
            } else {
                self.grasp_q[idx]
            }
        };
        joints.map(position).collect()
    }

    /// Places the hand.
    ///
    /// # Errors
    ///
    /// Fails if there is not one position per joint.
    pub fn placed(&self, hand: &HandState<Object>) -> Result<PlacedHand, ApproachError> {
        let object_from_palm = hand.frame_from_palm;
        let palm_from_links: Vec<Pose<Palm, Link>> = self.model.forward_kinematics(&hand.q_rad)?;
        let object_from_links = palm_from_links.iter().map(|link| object_from_palm * *link);
        Ok(PlacedHand {
            object_from_palm,
            object_from_links: object_from_links.collect(),
        })
    }

    /// Returns the least distances of the hand from object and table.
    ///
    /// # Errors
    ///
    /// Fails if there is not one position per joint.
    pub fn clearance(
        &self,
        environment: &Environment,
        hand: &HandState<Object>,
    ) -> Result<Clearance, ApproachError> {
        Ok(self.clearance_of(environment, &self.placed(hand)?, |_| true))
    }

    /// Returns the least distances of the links that a joint moves.
    pub(crate) fn clearance_of_joint(
        &self,
        environment: &Environment,
        placed: &PlacedHand,
        joint: usize,
    ) -> Clearance {
        self.clearance_of(environment, placed, |link| self.moves[joint][link])
    }

    /// Says whether a hand is nowhere deeper than this in object and table, in meters; it stops at the first link
    /// that is.
    pub fn is_clear(
        &self,
        environment: &Environment,
        placed: &PlacedHand,
        tolerance_m: f64,
    ) -> bool {
        let place = HandCollision::at(&placed.object_from_links);
        let deep = self
            .collision
            .find_in(environment, place, |radius_m, center| {
                let least_m = radius_m - tolerance_m;
                (!(center.object_m >= least_m && center.table_m >= least_m)).then_some(())
            });
        deep.is_none()
    }

    fn clearance_of(
        &self,
        environment: &Environment,
        placed: &PlacedHand,
        counts: impl Fn(usize) -> bool,
    ) -> Clearance {
        let place = HandCollision::at(&placed.object_from_links);
        self.collision.clearance(environment, place, counts)
    }

    /// Returns the points where links are within `tolerance_m` of the object, or inside it: of each group of
    /// neighboring spheres the nearest one.
    ///
    /// # Errors
    ///
    /// Fails if there is not one position per joint.
    pub fn touches(
        &self,
        environment: &Environment,
        hand: &HandState<Object>,
        tolerance_m: f64,
    ) -> Result<Vec<Touch>, ApproachError> {
        let placed = self.placed(hand)?;
        let mut touches = Vec::new();
        for cluster in self.collision.clusters() {
            let touch = |HandSphere { link, sphere, .. }: HandSphere| {
                let center = placed.object_from_link(link) * sphere.center_in_link;
                let distance = environment.signed_distance(&center);
                let normal_in_object = distance.gradient_in_object.try_normalize(1e-6)?;
                let gap_m = distance.distance_m - sphere.radius_m;
                (gap_m <= tolerance_m).then(|| Touch {
                    link,
                    point_in_object: center - normal_in_object * sphere.radius_m,
                    normal_in_object,
                    gap_m,
                })
            };
            let near = cluster.filter_map(touch);
            touches.extend(near.min_by(|a, b| a.gap_m.total_cmp(&b.gap_m)));
        }
        Ok(touches)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::fixture;

    fn open_at(body: &HandBody, place: [f64; 3]) -> HandState<Object> {
        HandState {
            frame_from_palm: Pose::from_parts(place, UnitQuaternion::identity()),
            q_rad: body.open(),
        }
    }

    /// The palm's box ends 11.1 mm before its origin, and the Allegro's fingers are straight along z.
    #[test]
    fn clearance_is_the_way_left_to_the_object_and_to_the_table() {
        let body = fixture::body();
        let environment = fixture::environment();
        let x = fixture::BOX_HALF_M[0];
        let far = body
            .clearance(&environment, &open_at(&body, [-0.3, 0.0, 0.06]))
            .unwrap();
        let near = body
            .clearance(&environment, &open_at(&body, [-0.29, 0.0, 0.06]))
            .unwrap();
        assert!(far.object_m > 0.1 && far.object_m < 0.3 - x, "{far:?}");
        assert!(
            (far.object_m - near.object_m - 0.01).abs() < 2e-3,
            "{far:?} {near:?}"
        );
        // The palm's lower edge is 95 mm below its origin, and the table 50 mm below the object's.
        assert!(
            (far.table_m - (0.06 - 0.095 + 0.05)).abs() < 2e-3,
            "{far:?}"
        );
        assert!((far.depth_m() - 0.0).abs() < 1e-12);
    }

    #[test]
    fn being_clear_is_what_the_clearance_says() {
        let body = fixture::body();
        let environment = fixture::environment();
        for x in [-0.3, -0.12, -0.1, -0.08, -0.06, -0.04] {
            for z in [0.0, 0.03, 0.06, 0.2] {
                let hand = open_at(&body, [x, 0.0, z]);
                let least_m = body.clearance(&environment, &hand).unwrap().least_m();
                let placed = body.placed(&hand).unwrap();
                let is_clear = body.is_clear(&environment, &placed, 1e-3);
                assert_eq!(is_clear, least_m >= -1e-3, "{x} {z}: {least_m}");
            }
        }
    }

    #[test]
    fn a_joint_moves_its_finger_alone() {
        let body = fixture::body();
        let joint = body.model.joint("joint_2.0").unwrap();
        let moved: Vec<&str> = body
            .model
            .links()
            .iter()
            .enumerate()
            .filter(|(link, _)| body.moves[joint][*link])
            .map(|(_, link)| link.name.as_str())
            .collect();
        assert_eq!(moved, ["link_2.0", "link_3.0", "link_3.0_tip"]);
    }

    #[test]
    fn a_touch_lies_on_the_box_with_its_normal_outward() {
        let body = fixture::body();
        let environment = fixture::environment();
        let clear = body
            .advanced(&environment, &open_at(&body, [-0.2, 0.0, 0.06]), 0.3)
            .unwrap();
        let touches = body.touches(&environment, &clear, 1e-3).unwrap();
        assert!(!touches.is_empty());
        for touch in touches {
            assert!(
                (touch.point_in_object.x + fixture::BOX_HALF_M[0]).abs() < 2e-3,
                "{touch:?}"
            );
            assert!(
                (touch.normal_in_object + Vector3::x()).norm() < 0.05,
                "{touch:?}"
            );
        }
    }
}
