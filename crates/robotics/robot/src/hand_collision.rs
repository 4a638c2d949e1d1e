//! Distances and depths of a hand in an object and a table, and of its links in each other.

use std::{cell::Cell, ops::Range};

use nalgebra::{Point3, Vector3};
use spatial::Pose;

use crate::{
    Link, RobotModel,
    spheres::{CollisionSphere, SLACK, TooLarge, clusters},
};

/// A hand's collision shapes as spheres, against an object's distance field and a table. [`SelfCollision`](crate::SelfCollision)
/// has them against each other.
///
/// Positions are in meters, in the frame of the poses that are given; depths and distances are in meters.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use robot::{HandCollision, RobotModel, Surroundings};
/// use spatial::Palm;
///
/// // A ball of 3 cm, 1 cm above a table; in the palm's frame, z up.
/// struct Ball;
/// impl Surroundings for Ball {
///     fn object_m(&self, point: &Point3<f64>) -> f64 {
///         (point - Point3::new(0.0, 0.0, 0.04)).norm() - 0.03
///     }
///     fn object_gradient(&self, point: &Point3<f64>) -> Vector3<f64> {
///         (point - Point3::new(0.0, 0.0, 0.04)).normalize()
///     }
///     fn table_m(&self, point: &Point3<f64>) -> f64 {
///         point.z
///     }
///     fn table_gradient(&self) -> Vector3<f64> {
///         Vector3::z()
///     }
/// }
///
/// let hand = RobotModel::from_urdf(r#"<robot name="h"><link name="palm"/><link name="tip"><collision>
///   <geometry><sphere radius="0.01"/></geometry></collision></link>
///   <joint name="j" type="prismatic"><parent link="palm"/><child link="tip"/>
///   <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"#)?;
/// let collision = HandCollision::new(&hand)?;
/// let links = hand.forward_kinematics::<Palm>(&[0.005])?;
/// let depth = collision.depth(&Ball, HandCollision::at(&links));
/// assert!((depth.object_m - 0.005).abs() < 1e-12 && (depth.table_m - 0.005).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct HandCollision {
    spheres: Vec<CollisionSphere>,
    clusters: Vec<Cluster>,
}

/// Neighboring spheres of one link.
#[derive(Debug, Clone)]
struct Cluster {
    link: usize,
    /// A sphere about all of them.
    around: CollisionSphere,
    /// Their numbers.
    spheres: Range<usize>,
}

/// A sphere of a hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandSphere {
    /// Its number: those that fill the links come first, then those about clusters of them.
    pub number: usize,
    /// Number of the link that it is fixed to, among the model's.
    pub link: usize,
    /// Center and radius.
    pub sphere: CollisionSphere,
}

/// An object and a table, as distances of points and their gradients, in one frame.
pub trait Surroundings {
    /// Returns the signed distance of a point from the object's surface in meters, negative inside.
    fn object_m(&self, point: &Point3<f64>) -> f64;
    /// Returns the gradient of that distance, about of length 1.
    fn object_gradient(&self, point: &Point3<f64>) -> Vector3<f64>;
    /// Returns the height of a point above the table in meters, negative below.
    fn table_m(&self, point: &Point3<f64>) -> f64;
    /// Returns the gradient of that height, which is the same everywhere.
    fn table_gradient(&self) -> Vector3<f64>;
}

/// Depth of a hand in object and table, in meters; 0 without penetration.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Depth {
    /// In the object.
    pub object_m: f64,
    /// Below the table.
    pub table_m: f64,
}

/// The least distances of a hand from object and table, in meters, negative inside; infinite without shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// From the object's surface.
    pub object_m: f64,
    /// Above the table.
    pub table_m: f64,
}

/// Penetration of a link, with its gradient: the depth of its deepest sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkDepth {
    /// The depth in meters, more than 0.
    pub depth_m: f64,
    /// The sphere's center in the link's frame: the depth changes as `-outward` · its velocity.
    pub center_in_link: Point3<f64>,
    /// Direction out of the object or table, about of length 1.
    pub outward: Vector3<f64>,
}

impl Depth {
    /// Returns the greater of the two, in meters.
    pub fn deepest_m(self) -> f64 {
        self.object_m.max(self.table_m)
    }
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

impl HandCollision {
    /// Fills a hand's collision shapes with spheres, and takes those that can meet.
    ///
    /// # Errors
    ///
    /// Fails if they are far larger than a hand's.
    pub fn new(hand: &RobotModel) -> Result<Self, TooLarge> {
        let mut spheres = Vec::new();
        let clusters = clusters(hand)?.into_iter().map(|cluster| {
            let first = spheres.len();
            spheres.extend(cluster.spheres);
            Cluster {
                link: cluster.link,
                around: cluster.around,
                spheres: first..spheres.len(),
            }
        });
        Ok(Self {
            clusters: clusters.collect(),
            spheres,
        })
    }

    /// Returns all spheres by their numbers, those about clusters last.
    pub fn spheres(&self) -> impl Iterator<Item = HandSphere> {
        let fill = self.clusters.iter().flat_map(|cluster| self.of(cluster));
        fill.chain((0..self.clusters.len()).map(|idx| self.around(idx)))
    }

    /// Returns the spheres of each cluster of neighbors on one link.
    pub fn clusters(&self) -> impl Iterator<Item = impl Iterator<Item = HandSphere>> {
        self.clusters.iter().map(|cluster| self.of(cluster))
    }

    /// Returns the places of spheres where the links have these poses.
    pub fn at<Frame>(
        frame_from_links: &[Pose<Frame, Link>],
    ) -> impl Fn(&HandSphere) -> Option<Point3<f64>> + Copy {
        |sphere| Some(*frame_from_links.get(sphere.link)? * sphere.sphere.center_in_link)
    }

    /// Returns the first result of `found` over the spheres of those clusters of which `near` says something by the
    /// sphere about them; both get a sphere and its center, and `found` what `near` said.
    ///
    /// `place` gives a sphere's center; one without a place is passed over.
    pub fn find<N, T>(
        &self,
        place: impl Fn(&HandSphere) -> Option<Point3<f64>>,
        near: impl Fn(&HandSphere, &Point3<f64>) -> Option<N>,
        mut found: impl FnMut(&HandSphere, &Point3<f64>, &N) -> Option<T>,
    ) -> Option<T> {
        for (idx, cluster) in self.clusters.iter().enumerate() {
            let around = self.around(idx);
            let Some(near) = place(&around).and_then(|center| near(&around, &center)) else {
                continue;
            };
            for sphere in self.of(cluster) {
                if let Some(center) = place(&sphere)
                    && let Some(result) = found(&sphere, &center, &near)
                {
                    return Some(result);
                }
            }
        }
        None
    }

    /// Returns the first result of `found` over the spheres that may be in object or table; it gets a sphere's radius
    /// and the distances of its center, in meters.
    pub fn find_in<T>(
        &self,
        surroundings: &impl Surroundings,
        place: impl Fn(&HandSphere) -> Option<Point3<f64>>,
        mut found: impl FnMut(f64, Clearance) -> Option<T>,
    ) -> Option<T> {
        self.find(
            place,
            |around, center| {
                may_be_in(surroundings, around, center)
                    .contains(&true)
                    .then_some(())
            },
            |sphere, center, ()| {
                let center_gaps = Clearance {
                    object_m: surroundings.object_m(center),
                    table_m: surroundings.table_m(center),
                };
                found(sphere.sphere.radius_m, center_gaps)
            },
        )
    }

    /// Returns the depth of the hand in object and table.
    pub fn depth(
        &self,
        surroundings: &impl Surroundings,
        place: impl Fn(&HandSphere) -> Option<Point3<f64>>,
    ) -> Depth {
        let mut depth = Depth::default();
        self.find_in(surroundings, place, |radius_m, center| {
            depth.object_m = depth.object_m.max(radius_m - center.object_m);
            depth.table_m = depth.table_m.max(radius_m - center.table_m);
            None::<()>
        });
        depth
    }

    /// Returns the depth of each link in the object and in the table, with gradients, in the order of the `n_links`
    /// links; `None` without penetration.
    pub fn link_depths(
        &self,
        surroundings: &impl Surroundings,
        place: impl Fn(&HandSphere) -> Option<Point3<f64>>,
        n_links: usize,
    ) -> Vec<[Option<LinkDepth>; 2]> {
        let mut deepest = vec![[None; 2]; n_links];
        self.find(
            place,
            |around, center| {
                let may_be_in = may_be_in(surroundings, around, center);
                may_be_in.contains(&true).then_some(may_be_in)
            },
            |sphere, center, may_be_in| {
                let of_link: &mut [Option<LinkDepth>; 2] = deepest.get_mut(sphere.link)?;
                let mut note = |which: usize, depth_m: f64, outward: &dyn Fn() -> Vector3<f64>| {
                    if depth_m > of_link[which].map_or(0.0, |known| known.depth_m) {
                        of_link[which] = Some(LinkDepth {
                            depth_m,
                            center_in_link: sphere.sphere.center_in_link,
                            outward: outward(),
                        });
                    }
                };
                let radius_m = sphere.sphere.radius_m;
                if may_be_in[0] {
                    let depth_m = radius_m - surroundings.object_m(center);
                    note(0, depth_m, &|| surroundings.object_gradient(center));
                }
                if may_be_in[1] {
                    let depth_m = radius_m - surroundings.table_m(center);
                    note(1, depth_m, &|| surroundings.table_gradient());
                }
                None::<()>
            },
        );
        deepest
    }

    /// Returns the least distances of those links from object and table that `counts` says of.
    pub fn clearance(
        &self,
        surroundings: &impl Surroundings,
        place: impl Fn(&HandSphere) -> Option<Point3<f64>>,
        counts: impl Fn(usize) -> bool,
    ) -> Clearance {
        let least = Cell::new(Clearance::FAR);
        self.find(
            place,
            |around, center| {
                let (reach_m, least) = (around.sphere.radius_m, least.get());
                let may_be_nearer = counts(around.link)
                    && (surroundings.object_m(center) - SLACK * reach_m < least.object_m
                        || surroundings.table_m(center) - reach_m < least.table_m);
                may_be_nearer.then_some(())
            },
            |sphere, center, ()| {
                let radius_m = sphere.sphere.radius_m;
                let Clearance { object_m, table_m } = least.get();
                least.set(Clearance {
                    object_m: object_m.min(surroundings.object_m(center) - radius_m),
                    table_m: table_m.min(surroundings.table_m(center) - radius_m),
                });
                None::<()>
            },
        );
        least.get()
    }

    fn of(&self, cluster: &Cluster) -> impl Iterator<Item = HandSphere> {
        let (link, first) = (cluster.link, cluster.spheres.start);
        let spheres = self.spheres[cluster.spheres.clone()].iter().enumerate();
        spheres.map(move |(idx, sphere)| HandSphere {
            number: first + idx,
            link,
            sphere: *sphere,
        })
    }

    fn around(&self, idx: usize) -> HandSphere {
        let cluster = &self.clusters[idx];
        HandSphere {
            number: self.spheres.len() + idx,
            link: cluster.link,
            sphere: cluster.around,
        }
    }
}

/// Says whether a sphere of a cluster may be in the object, and in the table.
fn may_be_in(
    surroundings: &impl Surroundings,
    around: &HandSphere,
    center: &Point3<f64>,
) -> [bool; 2] {
    let reach_m = around.sphere.radius_m;
    [
        // A distance changes by no more than the way gone.
        surroundings.object_m(center) < SLACK * reach_m,
        surroundings.table_m(center) < reach_m,
    ]
}

#[cfg(test)]
mod tests {
    use spatial::Palm;

    use super::*;

    /// A ball of 3 cm about a place, and a table 2 cm below it.
    struct Ball(Point3<f64>);

    impl Surroundings for Ball {
        fn object_m(&self, point: &Point3<f64>) -> f64 {
            (point - self.0).norm() - 0.03
        }
        fn object_gradient(&self, point: &Point3<f64>) -> Vector3<f64> {
            (point - self.0).normalize()
        }
        fn table_m(&self, point: &Point3<f64>) -> f64 {
            point.z - self.0.z + 0.02
        }
        fn table_gradient(&self) -> Vector3<f64> {
            Vector3::z()
        }
    }

    /// Depths, clearances and gradients are those of every sphere in turn, without clusters.
    #[test]
    fn clusters_change_no_depth() {
        let urdf = include_str!("../../../../data/robots/allegro_right.urdf");
        let hand = RobotModel::from_urdf(urdf).unwrap();
        let collision = HandCollision::new(&hand).unwrap();
        let links = hand.forward_kinematics::<Palm>(&hand.mid_range()).unwrap();
        let fill: Vec<CollisionSphere> = (hand.links().iter())
            .flat_map(|link| link.collisions.iter().flat_map(crate::spheres::fill))
            .collect();
        assert_eq!(collision.clusters().flatten().count(), fill.len());
        let mut n_in = 0;
        for (x, y, z) in [
            (0.06, 0.0, 0.03),
            (0.05, 0.02, 0.06),
            (0.09, -0.03, 0.04),
            (0.3, 0.0, 0.0),
        ] {
            let ball = Ball(Point3::new(x, y, z));
            let mut expected = Clearance::FAR;
            let mut by_link = vec![[0.0_f64; 2]; links.len()];
            for (link, body) in hand.links().iter().enumerate() {
                for sphere in body.collisions.iter().flat_map(crate::spheres::fill) {
                    let center = links[link] * sphere.center_in_link;
                    let gaps = [ball.object_m(&center), ball.table_m(&center)];
                    let [object_m, table_m] = gaps.map(|gap_m| gap_m - sphere.radius_m);
                    expected.object_m = expected.object_m.min(object_m);
                    expected.table_m = expected.table_m.min(table_m);
                    by_link[link][0] = by_link[link][0].max(-object_m);
                    by_link[link][1] = by_link[link][1].max(-table_m);
                }
            }
            let place = HandCollision::at(&links);
            assert_eq!(collision.clearance(&ball, place, |_| true), expected);
            let depth = collision.depth(&ball, place);
            assert_eq!(depth.object_m, (-expected.object_m).max(0.0));
            assert_eq!(depth.table_m, (-expected.table_m).max(0.0));
            let found = collision.link_depths(&ball, place, links.len());
            for ((link, found), expected) in found.iter().enumerate().zip(by_link) {
                for (found, expected) in found.iter().zip(expected) {
                    assert_eq!(found.map_or(0.0, |found| found.depth_m), expected);
                }
                let Some(found) = found[0] else { continue };
                n_in += 1;
                // Along its gradient the deepest sphere leaves the object.
                let center = links[link] * found.center_in_link;
                let ahead = ball.object_m(&(center + found.outward * 1e-6));
                let slope = (ahead - ball.object_m(&center)) / 1e-6;
                assert!((slope - 1.0).abs() < 1e-4, "{slope}");
            }
        }
        assert!(n_in > 2, "{n_in}");
    }
}
