//! Spheres that line a convex body from inside.

use nalgebra::Vector3;

use super::{LINING_RADIUS_M, SPACING_M};
use crate::ConvexBody;

/// Share of the depth of the body's center that spheres in a thin body have as radius.
const OF_DEPTH: f64 = 0.95;
/// Least distance between the centers of two spheres, as a share of [`SPACING_M`].
const APART: f64 = 0.5;
/// Rounds of [`inside`].
const ROUNDS: usize = 30;

/// Returns how many spheres are tried, of which those that are not too near to others remain.
pub(super) fn count(body: &ConvexBody) -> f64 {
    let tried = |corners: [Vector3<f64>; 3]| {
        let n = cuts(&corners);
        (n + 1.0) * (n + 2.0) / 2.0
    };
    body.surface().map(tried).sum()
}

/// Returns the centers of spheres, and their radius in meters: each lies in the body and touches a side
/// of it or nearly so.
pub(super) fn of(body: &ConvexBody) -> (Vec<Vector3<f64>>, f64) {
    let middle = body.center_m();
    let depths = body.sides().iter().map(|side| -side.beyond(&middle));
    let depth_m = depths.fold(f64::INFINITY, f64::min).max(0.0);
    let radius_m = LINING_RADIUS_M.min(OF_DEPTH * depth_m);
    let mut centers: Vec<Vector3<f64>> = Vec::new();
    for corners in body.surface() {
        for place in places(&corners) {
            let center = inside(body, &place, radius_m, &middle);
            let is_new = |other: &Vector3<f64>| (other - center).norm() > APART * SPACING_M;
            if centers.iter().all(is_new) {
                centers.push(center);
            }
        }
    }
    (centers, radius_m)
}

/// Returns into how many parts a triangle's sides are cut, so that none is longer than [`SPACING_M`].
fn cuts([a, b, c]: &[Vector3<f64>; 3]) -> f64 {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    (longest / SPACING_M).ceil().max(1.0)
}

/// Returns evenly spaced places on a triangle, its corners included.
fn places(corners: &[Vector3<f64>; 3]) -> Vec<Vector3<f64>> {
    let [a, b, c] = *corners;
    let n = cuts(corners);
    let mut places = Vec::new();
    let mut i = 0.0;
    while i <= n {
        let mut j = 0.0;
        while i + j <= n {
            places.push(a + (b - a) * (i / n) + (c - a) * (j / n));
            j += 1.0;
        }
        i += 1.0;
    }
    places
}

/// Returns the center nearest to a place of a sphere that lies in the body; `middle` is that of one.
///
/// By turns onto each side's plane (Boyle and Dykstra, *A method for finding projections onto the
/// intersection of convex sets in Hilbert spaces*, 1986), and the rest of the way towards the middle.
fn inside(
    body: &ConvexBody,
    place: &Vector3<f64>,
    radius_m: f64,
    middle: &Vector3<f64>,
) -> Vector3<f64> {
    let sides = body.sides();
    let mut center = *place;
    let mut taken = vec![0.0; sides.len()];
    for _ in 0..ROUNDS {
        for (side, taken) in sides.iter().zip(&mut taken) {
            let back = center + side.normal * *taken;
            *taken = (side.beyond(&back) + radius_m).max(0.0);
            center = back - side.normal * *taken;
        }
    }
    let towards = middle - center;
    let share = sides.iter().map(|side| {
        let over = side.beyond(&center) + radius_m;
        let speed = -side.normal.dot(&towards);
        if over > 0.0 && speed > 0.0 {
            (over / speed).min(1.0)
        } else {
            0.0
        }
    });
    center + towards * share.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::convex::tests::cuboid;

    /// A wedge: no two of its sides are parallel but its ends.
    fn wedge() -> ConvexBody {
        let corners = [
            [0.0, 0.0, 0.0],
            [0.03, 0.0, 0.0],
            [0.0, 0.02, 0.0],
            [0.0, 0.0, 0.03],
            [0.03, 0.0, 0.03],
            [0.0, 0.02, 0.03],
        ];
        let triangles = vec![
            [0, 2, 1],
            [3, 4, 5],
            [0, 1, 4],
            [0, 4, 3],
            [0, 3, 5],
            [0, 5, 2],
            [1, 2, 5],
            [1, 5, 4],
        ];
        ConvexBody::new(corners.map(Point3::from).to_vec(), triangles).unwrap()
    }

    #[test]
    fn balls_lie_in_the_body_and_reach_its_surface_about_everywhere() {
        let bodies = [
            cuboid(&Vector3::new(0.01, 0.014, 0.027)),
            cuboid(&Vector3::new(0.02, 0.056, 0.0475)),
            // A plate thinner than the spheres that line thick bodies.
            cuboid(&Vector3::new(0.03, 0.02, 0.002)),
            wedge(),
        ];
        for (idx, body) in bodies.iter().enumerate() {
            let (centers, radius_m) = of(body);
            for center in &centers {
                for side in body.sides() {
                    assert!(side.beyond(center) + radius_m < 1e-9, "{idx}: {center}");
                }
            }
            // What the spheres leave out is at most what they do of a box's corners and between two.
            let mut worst: f64 = 0.0;
            for corners in body.surface() {
                for place in places(&corners) {
                    let gaps = centers
                        .iter()
                        .map(|center| (center - place).norm() - radius_m);
                    worst = worst.max(gaps.fold(f64::INFINITY, f64::min));
                }
            }
            let sharp = if idx == 3 { 0.011 } else { 0.0065 };
            assert!(worst < sharp, "{idx}: {worst}");
            assert!(centers.len() as f64 <= count(body));
        }
    }

    #[test]
    fn a_box_of_a_mesh_and_a_primitive_box_get_about_as_many_balls() {
        for half_extents_m in [
            Vector3::new(0.01, 0.014, 0.027),
            Vector3::new(0.02, 0.056, 0.0475),
        ] {
            let (centers, _) = of(&cuboid(&half_extents_m));
            let primitive = crate::Collision {
                link_from_shape: spatial::Pose::identity(),
                shape: crate::Shape::Box { half_extents_m },
            };
            let n = super::super::fill(&primitive).len();
            assert!(
                (n / 2..2 * n).contains(&centers.len()),
                "{} of {n}",
                centers.len()
            );
        }
    }
}
