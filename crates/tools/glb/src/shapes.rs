//! Triangles of the shapes that links collide with.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use robot::Shape;

use crate::scene::{Geometry, single};

/// Sides of a circle.
const SIDES: u32 = 20;
/// Rings of a half ball.
const RINGS: u32 = 5;

/// Returns the triangles of a shape about its center, counterclockwise seen from outside.
pub(crate) fn triangles(shape: &Shape) -> Geometry {
    match shape {
        Shape::Box { half_extents_m } => cuboid(half_extents_m),
        Shape::Sphere { radius_m } => turned(&half_ball(*radius_m, 0.0)),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => turned(&[
            [0.0, -half_length_m],
            [*radius_m, -half_length_m],
            [*radius_m, *half_length_m],
            [0.0, *half_length_m],
        ]),
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => turned(&half_ball(*radius_m, *half_length_m)),
        Shape::Convex(body) => Geometry {
            positions: body
                .corners_m()
                .iter()
                .map(|corner| single(corner.coords))
                .collect(),
            triangles: body.triangles().to_vec(),
        },
    }
}

/// The profile of a ball, or of a capsule whose half length is given: distance from z, and z, from below.
fn half_ball(radius_m: f64, half_length_m: f64) -> Vec<[f64; 2]> {
    let at = |ring: u32| {
        let angle = PI / 2.0 * f64::from(ring) / f64::from(RINGS);
        [
            radius_m * angle.cos(),
            radius_m * angle.sin() + half_length_m,
        ]
    };
    let above: Vec<[f64; 2]> = (0..=RINGS)
        .map(at)
        .map(|[r, z]| [if r < 1e-12 { 0.0 } else { r }, z])
        .collect();
    let below = above.iter().rev().map(|&[r, z]| [r, -z]);
    let mut profile: Vec<[f64; 2]> = below.collect();
    let first = usize::from(half_length_m == 0.0);
    profile.extend(above.into_iter().skip(first));
    profile
}

/// The surface of a profile turned about z; the profile begins and ends on the axis, from below.
fn turned(profile: &[[f64; 2]]) -> Geometry {
    let mut shape = Geometry::default();
    let n = |shape: &Geometry| u32::try_from(shape.positions.len()).unwrap_or(u32::MAX);
    // The first vertex of each ring, and whether it is a point on the axis.
    let mut rings: Vec<(u32, bool)> = Vec::new();
    for &[radius, z] in profile {
        let is_point = radius == 0.0;
        rings.push((n(&shape), is_point));
        for side in 0..if is_point { 1 } else { SIDES } {
            let angle = TAU * f64::from(side) / f64::from(SIDES);
            let point = Vector3::new(radius * angle.cos(), radius * angle.sin(), z);
            shape.positions.push(single(point));
        }
    }
    for pair in rings.windows(2) {
        let &[(low, low_is_point), (high, high_is_point)] = pair else {
            continue;
        };
        for side in 0..SIDES {
            let next = (side + 1) % SIDES;
            let at = |ring: u32, is_point: bool, side: u32| ring + if is_point { 0 } else { side };
            if !low_is_point {
                let corners = [
                    at(low, false, side),
                    at(low, false, next),
                    at(high, high_is_point, next),
                ];
                shape.triangles.push(corners);
            }
            if !high_is_point {
                let corners = [
                    at(low, low_is_point, side),
                    at(high, false, next),
                    at(high, false, side),
                ];
                shape.triangles.push(corners);
            }
        }
    }
    shape
}

/// A box about the origin; each side has corners of its own, so that viewers shade it flat.
pub(crate) fn cuboid(half: &Vector3<f64>) -> Geometry {
    let mut shape = Geometry::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let first = u32::try_from(shape.positions.len()).unwrap_or(u32::MAX);
            for [right, up] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                let mut corner = Vector3::zeros();
                corner[axis] = sign * half[axis];
                corner[u] = right * half[u];
                corner[v] = up * half[v];
                shape.positions.push(single(corner));
            }
            let turns: [[u32; 3]; 2] = if sign > 0.0 {
                [[0, 1, 2], [0, 2, 3]]
            } else {
                [[0, 2, 1], [0, 3, 2]]
            };
            let corners = turns.map(|corners| corners.map(|corner| first + corner));
            shape.triangles.extend(corners);
        }
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(shape: &Geometry) -> f64 {
        let corner = |idx: u32| {
            let [x, y, z] = shape.positions[idx as usize];
            Vector3::new(f64::from(x), f64::from(y), f64::from(z))
        };
        let of = |&[a, b, c]: &[u32; 3]| corner(a).dot(&corner(b).cross(&corner(c))) / 6.0;
        shape.triangles.iter().map(of).sum()
    }

    /// Inward triangles would count negative.
    #[test]
    fn shapes_are_closed_outward_and_nearly_as_large_as_they_are() {
        let (r, half) = (0.02, 0.05);
        let ball = 4.0 / 3.0 * PI * r * r * r;
        let tube = PI * r * r * 2.0 * half;
        for (shape, expected) in [
            (
                Shape::Box {
                    half_extents_m: Vector3::new(0.01, 0.02, 0.03),
                },
                8.0 * 0.01 * 0.02 * 0.03,
            ),
            (Shape::Sphere { radius_m: r }, ball),
            (
                Shape::Cylinder {
                    radius_m: r,
                    half_length_m: half,
                },
                tube,
            ),
            (
                Shape::Capsule {
                    radius_m: r,
                    half_length_m: half,
                },
                tube + ball,
            ),
        ] {
            let shape = triangles(&shape);
            let ratio = volume(&shape) / expected;
            assert!((0.93..1.0001).contains(&ratio), "{ratio}");
            let mut edges: Vec<[u32; 2]> = Vec::new();
            for &[a, b, c] in &shape.triangles {
                edges.extend([[a, b], [b, c], [c, a]]);
            }
            edges.sort_unstable();
            let before = edges.len();
            edges.dedup();
            assert_eq!(
                before,
                edges.len(),
                "an edge is walked twice in one direction"
            );
        }
    }
}
