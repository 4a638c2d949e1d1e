//! Distances and depths between the links of a hand, with their gradients.

use nalgebra::{IsometryMatrix3, Matrix3, Point3, Vector3};
use spatial::Pose;

use crate::{
    Link, RobotModel, Shape, ShapePair,
    distance::{Corner, Nearest, to_origin},
    penetration::{Separation, way_out},
};

/// Radius with which edges are rounded, in meters: that of the spheres that line a box against objects. It takes
/// 1.2 mm off a box's edge and 2.2 mm off its corner, within the softness of a finger pad.
const ROUNDING_M: f64 = 0.003;
/// Distances are known this well, in meters, unless rounding keeps them from that.
const CLOSE_M: f64 = 1e-10;
/// Cores nearer than this overlap, in meters: their difference has no direction.
const TOUCHING_M: f64 = 1e-8;

/// Shapes are parted by a direction along which they are so much farther apart than the margin, in meters: rounding
/// makes up less, so that the same gaps are found without it.
const PARTED_M: f64 = 1e-9;

/// The collision shapes of a hand's links that can meet, as cores with a radius about them.
///
/// A sphere's core is a point, a capsule's a line segment, a box's and a cylinder's one that is smaller by
/// 3 mm all around; a convex part of a mesh is its own core. Of the ways to describe a link this one is
/// nearest to the URDF: on an Allegro's finger of 19.6 × 27.5 mm the widest capsule inside leaves out 4 mm on either
/// side, and the least one around sticks out by 7 mm.
///
/// The distance of two shapes is that of their cores less both radii. Cores that overlap are as deep as the shortest
/// translation that parts them. Distance and depth go over into each other, so that
/// the gap is continuous, and its gradient is wherever two cores are nearest along one direction.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    shapes: Vec<RoundedShape>,
    pairs: Vec<ShapePair>,
}

/// A collision shape of a link.
#[derive(Debug, Clone)]
struct RoundedShape {
    link: usize,
    link_from_shape: PlacedShape,
    core: Shape,
    /// Distance of the surface from the core, in meters.
    radius_m: f64,
    /// Radius of a ball about the shape's center that holds it, in meters.
    reach_m: f64,
}

/// A shape where it is.
#[derive(Debug, Clone, Copy)]
struct PlacedShape {
    rotation: Matrix3<f64>,
    center: Vector3<f64>,
}

impl PlacedShape {
    fn of<A, B>(pose: &Pose<A, B>) -> Self {
        Self {
            rotation: pose.rotation.to_rotation_matrix().into_inner(),
            center: pose.translation.vector,
        }
    }

    /// Returns the shape, which is placed in a link, where the link is at this pose.
    #[inline]
    fn moved(&self, frame_from_link: &IsometryMatrix3<f64>) -> Self {
        let turn = frame_from_link.rotation.matrix();
        let [x, y, z] = [0, 1, 2].map(|axis| turn.column(axis));
        // Column by column: nalgebra's general product is several times slower.
        let turned = |v: Vector3<f64>| x * v.x + y * v.y + z * v.z;
        let [u, v, w] = [0, 1, 2].map(|axis| turned(self.rotation.column(axis).into_owned()));
        Self {
            rotation: Matrix3::from_columns(&[u, v, w]),
            center: turned(self.center) + frame_from_link.translation.vector,
        }
    }
}

/// The gap between two links, in the frame in which the links' poses were given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfGap {
    /// The links, by their numbers among the model's.
    pub links: [usize; 2],
    /// The points of their surfaces that are nearest to each other, or deepest in each other, in meters.
    pub points: [Point3<f64>; 2],
    /// Unit vector along which the second link moves away from the first.
    pub normal: Vector3<f64>,
    /// The gap in meters, negative where they overlap.
    ///
    /// Where `v` are the velocities of the two points, its rate is `normal · (v[1] − v[0])`.
    pub gap_m: f64,
}

/// Gaps of a posture, and memory for the next one's.
#[derive(Debug, Clone, Default)]
pub struct SelfGaps {
    gaps: Vec<SelfGap>,
    placed: Vec<PlacedShape>,
    /// For each pair the direction that parted it last: where it still does, nothing else is computed
    /// (Chung and Wang, *Quick Collision Detection of Polytopes in Virtual Environments*, 1996).
    partings: Vec<Vector3<f64>>,
}

impl SelfGaps {
    /// Returns the gaps found last.
    pub fn gaps(&self) -> &[SelfGap] {
        &self.gaps
    }

    /// Returns the greatest depth of a link in another, in meters; 0 without penetration.
    pub fn depth_m(&self) -> f64 {
        self.gaps.iter().map(|gap| -gap.gap_m).fold(0.0, f64::max)
    }
}

impl SelfCollision {
    /// Takes a hand's collision shapes and those of their pairs that touch ([`HandShape::touches`](crate::HandShape)),
    /// without those that [`RobotModel::shape_pairs`] leaves out: links of one finger are left to the limits of its
    /// joints.
    pub fn new(hand: &RobotModel) -> Self {
        let links = hand.links().iter().enumerate();
        let shapes = links.flat_map(|(link, body)| {
            body.collisions.iter().map(move |collision| {
                let (core, radius_m) = rounded(&collision.shape);
                RoundedShape {
                    link,
                    link_from_shape: PlacedShape::of(&collision.link_from_shape),
                    reach_m: core.radius_m() + radius_m,
                    core,
                    radius_m,
                }
            })
        });
        let of_hand = hand.hand_shapes();
        let mut pairs = hand.shape_pairs(|_, _| true);
        pairs.retain(|pair| of_hand[pair.first].touches(&of_hand[pair.second]));
        Self {
            shapes: shapes.collect(),
            pairs,
        }
    }

    /// Returns the pairs of links that can meet, each as often as it has pairs of shapes.
    pub fn link_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        let of = |pair: &ShapePair| [pair.first, pair.second].map(|idx| self.shapes[idx].link);
        self.pairs.iter().map(of)
    }

    /// Looks for pairs of shapes nearer to each other than `margin_m`, in the order of the links, and returns their
    /// gaps; `frame_from_links` are the poses of the model's links, in any frame.
    ///
    /// It allocates nothing once `gaps` has its size. Balls about the shapes part most pairs, and most others the
    /// direction that parted them at the posture before; that changes no result.
    ///
    /// # Panics
    ///
    /// Panics if there is no pose for a link that has a shape.
    pub fn gaps<'g, Frame>(
        &self,
        frame_from_links: &[Pose<Frame, Link>],
        margin_m: f64,
        gaps: &'g mut SelfGaps,
    ) -> &'g [SelfGap] {
        let pose = |link: usize| {
            let pose = &frame_from_links[link];
            IsometryMatrix3::from_parts(pose.translation, pose.rotation.to_rotation_matrix())
        };
        self.gaps_at(pose, margin_m, gaps)
    }

    /// As [`SelfCollision::gaps`], with a function that returns a link's pose, for each link that has a shape.
    pub fn gaps_at<'g>(
        &self,
        frame_from_link: impl Fn(usize) -> IsometryMatrix3<f64>,
        margin_m: f64,
        gaps: &'g mut SelfGaps,
    ) -> &'g [SelfGap] {
        gaps.gaps.clear();
        gaps.placed.clear();
        let places = self.shapes.iter();
        let places = places.map(|shape| shape.link_from_shape.moved(&frame_from_link(shape.link)));
        gaps.placed.extend(places);
        gaps.partings.resize(self.pairs.len(), Vector3::zeros());
        for (pair, parting) in self.pairs.iter().zip(&mut gaps.partings) {
            let [a, b] =
                [pair.first, pair.second].map(|idx| (&self.shapes[idx], &gaps.placed[idx]));
            let near_m = a.0.reach_m + b.0.reach_m + margin_m;
            if (a.1.center - b.1.center).norm_squared() < near_m * near_m
                && !are_parted(a, b, parting, margin_m)
                && let Some(gap) = gap(a, b, margin_m, parting)
            {
                gaps.gaps.push(gap);
            }
        }
        &gaps.gaps
    }
}

impl RobotModel {
    /// Adds a factor times the gradient of a gap by the joint positions, in meters per radian (per meter if prismatic);
    /// `by_q` has one number for each joint, and `frame_from_links` are the poses of which the gap was found.
    ///
    /// The rate of a point per velocity of a joint is its column of the geometric Jacobian: see
    /// [`RobotModel::geometric_jacobian`].
    pub fn add_gap_gradient<Frame>(
        &self,
        frame_from_links: &[Pose<Frame, Link>],
        gap: &SelfGap,
        factor: f64,
        by_q: &mut [f64],
    ) {
        let ends = gap.links.into_iter().zip(&gap.points);
        for ((link, point), sign) in ends.zip([-factor, factor]) {
            self.each_joint_velocity(frame_from_links, link, point, |joint, velocity| {
                if let Some(by_q) = by_q.get_mut(joint) {
                    *by_q += sign * gap.normal.dot(&velocity);
                }
            });
        }
    }
}

/// Returns the core of a shape and the radius about it.
fn rounded(shape: &Shape) -> (Shape, f64) {
    match shape {
        Shape::Sphere { radius_m } => (Shape::Sphere { radius_m: 0.0 }, *radius_m),
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => {
            let core = Shape::Capsule {
                radius_m: 0.0,
                half_length_m: *half_length_m,
            };
            (core, *radius_m)
        }
        Shape::Box { half_extents_m } => {
            let radius_m = ROUNDING_M.min(half_extents_m.min());
            let core = Shape::Box {
                half_extents_m: half_extents_m.add_scalar(-radius_m),
            };
            (core, radius_m)
        }
        Shape::Cylinder {
            radius_m: outer_m,
            half_length_m,
        } => {
            let radius_m = ROUNDING_M.min(*outer_m).min(*half_length_m);
            let core = Shape::Cylinder {
                radius_m: outer_m - radius_m,
                half_length_m: half_length_m - radius_m,
            };
            (core, radius_m)
        }
        Shape::Convex(_) => (shape.clone(), 0.0),
    }
}

/// Says whether a gap of more than `margin_m` lies between two shapes along a direction from the first to the second,
/// which is 0 where none is known.
fn are_parted(
    (a, at_a): (&RoundedShape, &PlacedShape),
    (b, at_b): (&RoundedShape, &PlacedShape),
    direction: &Vector3<f64>,
    margin_m: f64,
) -> bool {
    let own = [(at_a, 1.0), (at_b, -1.0)].map(|(at, sign)| at.rotation.tr_mul(direction) * sign);
    let ends_m = a.core.farthest(&own[0]).dot(&own[0]) + b.core.farthest(&own[1]).dot(&own[1]);
    let core_gap_m = (at_b.center - at_a.center).dot(direction) - ends_m;
    core_gap_m > a.radius_m + b.radius_m + margin_m + PARTED_M
}

/// Returns the gap between two shapes; `None` if it is more than `margin_m`, and then the direction that parts them in
/// `parting`.
fn gap(
    (a, at_a): (&RoundedShape, &PlacedShape),
    (b, at_b): (&RoundedShape, &PlacedShape),
    margin_m: f64,
    parting: &mut Vector3<f64>,
) -> Option<SelfGap> {
    // In the first shape's frame, so that only one of them is turned.
    let turn = at_a.rotation.tr_mul(&at_b.rotation);
    let offset = at_a.rotation.tr_mul(&(at_b.center - at_a.center));
    let farthest = |direction: &Vector3<f64>| {
        let on_first = a.core.farthest(direction);
        let on_second = turn * b.core.farthest(&-turn.tr_mul(direction)) + offset;
        Corner {
            difference: on_first - on_second,
            on_first,
        }
    };
    let radii_m = a.radius_m + b.radius_m;
    let found = to_origin(farthest, -offset, CLOSE_M, radii_m + margin_m);
    let (normal, core_gap_m, on_first) = if found.high > TOUCHING_M {
        let Nearest {
            difference,
            simplex,
            ..
        } = found;
        (
            -difference / found.high,
            found.high,
            simplex.nearest_on_first(),
        )
    } else {
        match way_out(farthest, &found.simplex) {
            Some(Separation {
                depth_m,
                along,
                on_first,
            }) => (along, -depth_m, on_first),
            // Points, or lines in one plane: any way parts them that is across both.
            None => (
                across(&turn, &offset),
                0.0,
                found.simplex.nearest_on_first(),
            ),
        }
    };
    let gap_m = core_gap_m - radii_m;
    if gap_m >= margin_m {
        *parting = at_a.rotation * normal;
        return None;
    }
    let first = on_first + normal * a.radius_m;
    let second = on_first + normal * (core_gap_m - b.radius_m);
    let place = |point: Vector3<f64>| Point3::from(at_a.rotation * point + at_a.center);
    Some(SelfGap {
        links: [a.link, b.link],
        points: [place(first), place(second)],
        normal: at_a.rotation * normal,
        gap_m,
    })
}

/// Returns a direction across the axes of two shapes whose cores meet without overlapping.
fn across(turn: &Matrix3<f64>, offset: &Vector3<f64>) -> Vector3<f64> {
    let axes = Vector3::z().cross(&turn.column(2));
    let ways = [axes, *offset, Vector3::x()];
    let found = ways.iter().find_map(|way| way.try_normalize(1e-9));
    found.unwrap_or_else(Vector3::x)
}

#[cfg(test)]
mod tests;
