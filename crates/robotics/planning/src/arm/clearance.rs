//! Clearance of the arm's links from the table, from each other and from the hand.

use nalgebra::Vector3;
use robot::{Kinship, Link, RobotModel, Shape, distance_bounds};
use spatial::{Base, Pose};

use super::hand::beyond;
use crate::infeasible::{ArmFault, PathPoint};

/// Minimum distance between links with one other between them, in meters.
const NEIGHBORS_M: f64 = 0.001;

/// The collision shapes of an arm with its hand, and those that must keep apart.
///
/// Shapes are those of the URDF, and distances between them are exact within 0.01 mm. Between sampled
/// points, half the relative displacement of two shapes is added to the required clearance (first order).
#[derive(Debug, Clone)]
pub(crate) struct Clearance {
    shapes: Vec<LinkShape>,
    /// Shapes that must keep from each other.
    pairs: Vec<Pair>,
    /// Shapes that must keep from the table: all that the arm moves, without the hand.
    above: Vec<usize>,
    least_m: f64,
}

/// Two shapes that must keep from each other.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub(crate) first: usize,
    pub(crate) second: usize,
    /// Minimum distance, in meters.
    pub(crate) least_m: f64,
}

/// A collision shape of a link.
#[derive(Debug, Clone)]
struct LinkShape {
    link: usize,
    name: String,
    link_from_shape: Pose<Link, Shape>,
    shape: Shape,
}

/// Poses of the robot's links at one point of a path.
#[derive(Debug, Clone)]
pub(crate) struct LinkPoses {
    pub(crate) at: PathPoint,
    /// Pose of each link in the frame of the arm's base.
    pub(crate) base_from_links: Vec<Pose<Base, Link>>,
}

impl Clearance {
    /// Takes the shapes of a robot whose link `palm` is the hand's.
    ///
    /// Pairs are those of [`RobotModel::shape_pairs`] without the hand's own, as the arm does not change their distances.
    /// Links with one other between them come near each other by design, and a joint's limits keep
    /// them apart: they may come as near as [`NEIGHBORS_M`].
    pub(crate) fn new(robot: &RobotModel, palm: usize, least_m: f64) -> Self {
        let carried = beyond(robot, palm);
        let is_fixed = |link: usize| {
            robot
                .up_from(link)
                .all(|idx| robot.links()[idx].kind.is_none())
        };
        let shapes = link_shapes(robot);
        let pairs = robot.shape_pairs(|a, b| !(carried[a] && carried[b]));
        let pairs = pairs.into_iter().map(|pair| Pair {
            first: pair.first,
            second: pair.second,
            least_m: match pair.kinship {
                Kinship::Grandparent | Kinship::Siblings => least_m.min(NEIGHBORS_M),
                Kinship::Far => least_m,
            },
        });
        let above = shapes.iter().enumerate();
        let above = above.filter(|(_, shape)| !is_fixed(shape.link) && !carried[shape.link]);
        Self {
            above: above.map(|(idx, _)| idx).collect(),
            shapes,
            pairs: pairs.collect(),
            least_m,
        }
    }

    /// Checks a path, given at points close to each other in their order.
    ///
    /// `up_in_base` is the table's vertical in the frame of the arm's base, and `base_height_m` the height of that
    /// frame's origin above the table.
    pub(crate) fn check(
        &self,
        link_poses: &[LinkPoses],
        up_in_base: &Vector3<f64>,
        base_height_m: f64,
    ) -> Result<(), ArmFault> {
        let poses: Vec<Vec<Pose<Base, Shape>>> = self
            .shapes
            .iter()
            .map(|shape| {
                let link_poses = link_poses.iter();
                link_poses
                    .map(|all| shape.pose(&all.base_from_links))
                    .collect()
            })
            .collect();
        let paths: Vec<ShapePath<'_>> = self
            .shapes
            .iter()
            .zip(&poses)
            .map(|(shape, poses)| ShapePath::new(shape, poses))
            .collect();
        for &idx in &self.above {
            self.check_table(&paths[idx], link_poses, up_in_base, base_height_m)?;
        }
        for pair in &self.pairs {
            check_pair(
                &paths[pair.first],
                &paths[pair.second],
                pair.least_m,
                link_poses,
            )?;
        }
        Ok(())
    }

    fn check_table(
        &self,
        path: &ShapePath<'_>,
        link_poses: &[LinkPoses],
        up_in_base: &Vector3<f64>,
        base_height_m: f64,
    ) -> Result<(), ArmFault> {
        for (idx, (pose, links)) in path.poses.iter().zip(link_poses).enumerate() {
            let lowest_m = base_height_m + path.link_shape.shape.lowest_m(pose, up_in_base);
            let gap_m = lowest_m - 0.5 * path.max_displacement_m(idx);
            // NaN is not clear.
            let is_clear = gap_m >= self.least_m;
            if !is_clear {
                return Err(ArmFault::Table {
                    link: path.link_shape.name.clone(),
                    gap_m,
                    least_m: self.least_m,
                    at: links.at,
                });
            }
        }
        Ok(())
    }
}

/// Checks two shapes, measuring only where they may have come too near since they were measured last.
fn check_pair(
    a: &ShapePath<'_>,
    b: &ShapePath<'_>,
    least_m: f64,
    link_poses: &[LinkPoses],
) -> Result<(), ArmFault> {
    let mut apart_m = f64::NEG_INFINITY;
    let mut moved_m = 0.0;
    for (idx, ((at_a, at_b), links)) in a.poses.iter().zip(b.poses).zip(link_poses).enumerate() {
        apart_m -= moved_m;
        moved_m = a.displacement_to_next_m(idx) + b.displacement_to_next_m(idx);
        let needed_m = least_m + 0.5 * (a.max_displacement_m(idx) + b.max_displacement_m(idx));
        if apart_m >= needed_m {
            continue;
        }
        let centers_m = (at_a.translation.vector - at_b.translation.vector).norm();
        apart_m = centers_m - a.radius_m - b.radius_m;
        if apart_m >= needed_m {
            continue;
        }
        apart_m =
            distance_bounds((at_a, &a.link_shape.shape), (at_b, &b.link_shape.shape)).at_least_m;
        // Motion that both share brings them no nearer.
        let slack_m = 0.5 * relative_displacement_m(a, b, idx);
        let is_clear = apart_m >= least_m + slack_m;
        if !is_clear {
            return Err(ArmFault::Collision {
                first: a.link_shape.name.clone(),
                second: b.link_shape.name.clone(),
                gap_m: (apart_m - slack_m).max(0.0),
                least_m,
                at: links.at,
            });
        }
    }
    Ok(())
}

/// Returns a bound on the displacement of points of one shape in the frame of the other, to the next
/// point of the path and from the last one, whichever is greater.
fn relative_displacement_m(a: &ShapePath<'_>, b: &ShapePath<'_>, idx: usize) -> f64 {
    let pose = |idx: usize| Some(a.poses.get(idx)?.inverse() * *b.poses.get(idx)?);
    let Some(here) = pose(idx) else { return 0.0 };
    let neighbors = [idx.checked_sub(1), Some(idx + 1)].into_iter().flatten();
    neighbors
        .filter_map(pose)
        .map(|there| displacement_m(&here, &there, b.radius_m))
        .fold(0.0, f64::max)
}

/// Returns a bound on the displacement of points within a radius of a pose's origin, to another pose.
fn displacement_m<Frame>(from: &Pose<Frame, Shape>, to: &Pose<Frame, Shape>, radius_m: f64) -> f64 {
    let distance = (to.translation.vector - from.translation.vector).norm();
    distance + from.rotation.angle_to(&to.rotation) * radius_m
}

/// A collision shape along a path.
struct ShapePath<'a> {
    link_shape: &'a LinkShape,
    radius_m: f64,
    poses: &'a [Pose<Base, Shape>],
    /// Bounds on the displacement of its points from each point of the path to the next.
    displacements_m: Vec<f64>,
}

impl<'a> ShapePath<'a> {
    fn new(link_shape: &'a LinkShape, poses: &'a [Pose<Base, Shape>]) -> Self {
        let radius_m = link_shape.shape.radius_m();
        let displacements_m = poses.windows(2).map(|pair| match pair {
            [from, to] => displacement_m(from, to, radius_m),
            _ => 0.0,
        });
        Self {
            link_shape,
            radius_m,
            poses,
            displacements_m: displacements_m.collect(),
        }
    }

    /// Returns the bound on the displacement of its points to the next point of the path.
    fn displacement_to_next_m(&self, idx: usize) -> f64 {
        self.displacements_m.get(idx).copied().unwrap_or(0.0)
    }

    /// Returns the greater of the bounds on the displacement to the next point and from the last one.
    fn max_displacement_m(&self, idx: usize) -> f64 {
        let before = idx
            .checked_sub(1)
            .map_or(0.0, |before| self.displacement_to_next_m(before));
        before.max(self.displacement_to_next_m(idx))
    }
}

impl LinkShape {
    fn pose(&self, base_from_links: &[Pose<Base, Link>]) -> Pose<Base, Shape> {
        base_from_links[self.link] * self.link_from_shape
    }
}

fn link_shapes(robot: &RobotModel) -> Vec<LinkShape> {
    let links = robot.links().iter().enumerate();
    links
        .flat_map(|(link, body)| {
            body.collisions.iter().map(move |collision| LinkShape {
                link,
                name: body.name.clone(),
                link_from_shape: collision.link_from_shape,
                shape: collision.shape.clone(),
            })
        })
        .collect()
}

#[cfg(test)]
impl Clearance {
    /// Names of the links of each pair that must not meet.
    pub(crate) fn names(&self) -> Vec<[String; 2]> {
        let name = |idx: usize| self.shapes[idx].name.clone();
        let pairs = self.pairs.iter();
        pairs
            .map(|pair| [name(pair.first), name(pair.second)])
            .collect()
    }

    pub(crate) fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    pub(crate) fn above(&self) -> &[usize] {
        &self.above
    }

    /// A link's shape and its pose in the frame of the arm's base.
    pub(crate) fn shape_at(
        &self,
        idx: usize,
        base_from_links: &[Pose<Base, Link>],
    ) -> (Pose<Base, Shape>, Shape) {
        let shape = &self.shapes[idx];
        (shape.pose(base_from_links), shape.shape.clone())
    }
}
