//! Distances of a hand from an object and a table, link by link.

use motion::HandState;
use nalgebra::{Point3, Vector3};
use posture::Environment;
use robot::{
    Link, RobotModel,
    spheres::{CollisionSphere, SLACK, SphereCluster, clusters},
};
use spatial::{Object, Palm, Pose};

use crate::{ApproachError, HandAxes};

/// A hand whose collision shapes are filled with spheres, and which joints bend its fingers.
#[derive(Debug, Clone)]
pub struct HandBody {
    pub(crate) model: RobotModel,
    clusters: Vec<SphereCluster>,
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
    palm_from_links: Vec<Pose<Palm, Link>>,
}

/// The least distances of a hand from object and table, in meters, negative inside; infinite without shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// From the object's surface.
    pub object_m: f64,
    /// Above the table.
    pub table_m: f64,
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

impl Clearance {
    const FAR: Self = Self {
        object_m: f64::INFINITY,
        table_m: f64::INFINITY,
    };

    /// Returns the least of both, in meters.
    pub fn least_m(self) -> f64 {
        self.object_m.min(self.table_m)
    }

    /// Returns the penetration depth of the hand in object or table, in meters; 0 without penetration.
    pub fn depth_m(self) -> f64 {
        (-self.least_m()).max(0.0)
    }
}

impl PlacedHand {
    /// Returns the pose of a link in the object's frame; the palm's for a link that does not exist.
    pub fn object_from_link(&self, link: usize) -> Pose<Object, Link> {
        match self.palm_from_links.get(link) {
            Some(palm_from_link) => self.object_from_palm * *palm_from_link,
            None => self.object_from_palm.reinterpret(),
        }
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
        let clusters = clusters(&model)?;
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
            clusters,
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
        Ok(PlacedHand {
            object_from_palm: hand.frame_from_palm,
            palm_from_links: self.model.forward_kinematics(&hand.q_rad)?,
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
        self.clusters.iter().all(|cluster| {
            let object_from_link = placed.object_from_link(cluster.link);
            let center = object_from_link * cluster.around.center_in_link;
            let reach_m = cluster.around.radius_m;
            let may_touch = environment.signed_distance(&center).distance_m < SLACK * reach_m
                || environment.height_m(&center) < reach_m;
            !may_touch
                || cluster.spheres.iter().all(|sphere| {
                    let center = object_from_link * sphere.center_in_link;
                    let least_m = sphere.radius_m - tolerance_m;
                    environment.signed_distance(&center).distance_m >= least_m
                        && environment.height_m(&center) >= least_m
                })
        })
    }

    fn clearance_of(
        &self,
        environment: &Environment,
        placed: &PlacedHand,
        counts: impl Fn(usize) -> bool,
    ) -> Clearance {
        let mut least = Clearance::FAR;
        for cluster in self.clusters.iter().filter(|cluster| counts(cluster.link)) {
            let object_from_link = placed.object_from_link(cluster.link);
            let center = object_from_link * cluster.around.center_in_link;
            let reach_m = cluster.around.radius_m;
            let off_m = environment.signed_distance(&center).distance_m - SLACK * reach_m;
            let is_near_object = off_m < least.object_m;
            let is_near_table = environment.height_m(&center) - reach_m < least.table_m;
            if !(is_near_object || is_near_table) {
                continue;
            }
            for sphere in &cluster.spheres {
                let center = object_from_link * sphere.center_in_link;
                let off_m = environment.signed_distance(&center).distance_m - sphere.radius_m;
                least.object_m = least.object_m.min(off_m);
                let off_m = environment.height_m(&center) - sphere.radius_m;
                least.table_m = least.table_m.min(off_m);
            }
        }
        least
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
        for cluster in &self.clusters {
            let object_from_link = placed.object_from_link(cluster.link);
            let touch = |sphere: &CollisionSphere| {
                let center = object_from_link * sphere.center_in_link;
                let distance = environment.signed_distance(&center);
                let normal_in_object = distance.gradient_in_object.try_normalize(1e-6)?;
                let gap_m = distance.distance_m - sphere.radius_m;
                (gap_m <= tolerance_m).then(|| Touch {
                    link: cluster.link,
                    point_in_object: center - normal_in_object * sphere.radius_m,
                    normal_in_object,
                    gap_m,
                })
            };
            let near = cluster.spheres.iter().filter_map(touch);
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
