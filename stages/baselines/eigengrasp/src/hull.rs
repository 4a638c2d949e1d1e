//! The distance of a hull's nearest facet from the origin, in six dimensions.

use std::collections::BTreeMap;

use nalgebra::Vector6;

/// Dimensions of a wrench.
const N: usize = 6;
/// Size of the random displacements after which no seven points lie on one facet, relative to wrenches about 1 long.
const JOGGLE: f64 = 1e-7;
/// Distance below which a point is not outside a facet.
const NEAR: f64 = 1e-9;
/// Size below which points lie in a plane.
const FLAT: f64 = 1e-6;
/// Most facets that are made: far more than tens of contacts take.
const MAX_FACETS: usize = 200_000;

/// A facet: its six vertices, and the plane `normal · x = offset` through them, outward.
struct Facet {
    vertices: [usize; N],
    normal: Vector6<f64>,
    offset: f64,
}

/// Returns the distance from the origin to the nearest facet of the hull of points, negative if the origin is outside:
/// the radius of the largest ball about the origin within the hull (Ferrari and Canny, 1992). `None` if the points lie
/// in a plane.
///
/// The hull is grown from a simplex at the facet nearest to the origin alone, until that is a facet of the hull: an
/// expanding polytope (van den Bergen, "Proximity queries and penetration depth computation on 3D game objects", 2001;
/// for wrenches, Zheng, "An efficient algorithm for a grasp quality measure", 2013). Exact up to the joggle.
pub(crate) fn ball_radius(points: &[Vector6<f64>]) -> Option<f64> {
    let points = joggled(points);
    let simplex = simplex(&points)?;
    let inside = simplex.iter().map(|&idx| points[idx]).sum::<Vector6<f64>>() / 7.0;
    let mut facets = Vec::new();
    for left_out in 0..=N {
        let mut vertices = [0; N];
        let rest = simplex
            .iter()
            .enumerate()
            .filter(|(idx, _)| *idx != left_out);
        for (to, (_, &vertex)) in vertices.iter_mut().zip(rest) {
            *to = vertex;
        }
        facets.push(facet(&points, vertices, &inside)?);
    }
    while facets.len() < MAX_FACETS {
        let nearest = facets.iter().min_by(|a, b| a.offset.total_cmp(&b.offset))?;
        let beyond = |point: &Vector6<f64>| nearest.normal.dot(point) - nearest.offset;
        let farthest =
            (0..points.len()).max_by(|&a, &b| beyond(&points[a]).total_cmp(&beyond(&points[b])))?;
        if beyond(&points[farthest]) <= NEAR {
            return Some(nearest.offset);
        }
        let point = points[farthest];
        let is_visible = |facet: &Facet| facet.normal.dot(&point) > facet.offset + NEAR / 10.0;
        let (seen, kept): (Vec<Facet>, Vec<Facet>) = facets.into_iter().partition(is_visible);
        facets = kept;
        for ridge in horizon(&seen) {
            let mut vertices = [farthest; N];
            vertices[..N - 1].copy_from_slice(&ridge);
            facets.push(facet(&points, vertices, &inside)?);
        }
    }
    None
}

/// Returns the ridges that belong to one of the facets alone.
fn horizon(seen: &[Facet]) -> Vec<[usize; N - 1]> {
    let mut counts: BTreeMap<[usize; N - 1], usize> = BTreeMap::new();
    for facet in seen {
        for left_out in 0..N {
            let mut ridge = [0; N - 1];
            let rest = facet
                .vertices
                .iter()
                .enumerate()
                .filter(|(idx, _)| *idx != left_out);
            for (to, (_, &vertex)) in ridge.iter_mut().zip(rest) {
                *to = vertex;
            }
            ridge.sort_unstable();
            *counts.entry(ridge).or_default() += 1;
        }
    }
    let single = counts.into_iter().filter(|(_, count)| *count == 1);
    single.map(|(ridge, _)| ridge).collect()
}

/// Moves points a little, each by its own number.
fn joggled(points: &[Vector6<f64>]) -> Vec<Vector6<f64>> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    // A generator of Marsaglia ("Xorshift RNGs", 2003): the numbers need only differ.
    let mut number = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let joggle = |point: &Vector6<f64>| point + Vector6::from_fn(|_, _| number()) * JOGGLE;
    points.iter().map(joggle).collect()
}

/// Returns seven points that span the space, each the farthest from the span of those before it.
fn simplex(points: &[Vector6<f64>]) -> Option<[usize; N + 1]> {
    let first = (0..points.len()).max_by(|&a, &b| points[a].norm().total_cmp(&points[b].norm()))?;
    let mut chosen = [first; N + 1];
    let mut left: Vec<Vector6<f64>> = points.iter().map(|point| point - points[first]).collect();
    for slot in chosen.iter_mut().skip(1) {
        let farthest =
            (0..left.len()).max_by(|&a, &b| left[a].norm().total_cmp(&left[b].norm()))?;
        let way = left[farthest].try_normalize(FLAT)?;
        *slot = farthest;
        for point in &mut left {
            *point -= way * way.dot(point);
        }
    }
    Some(chosen)
}

/// Returns the facet through six points, outward from a point inside; `None` if they do not span it.
fn facet(points: &[Vector6<f64>], vertices: [usize; N], inside: &Vector6<f64>) -> Option<Facet> {
    let first = points[vertices[0]];
    let mut rows: Vec<Vector6<f64>> = vertices[1..]
        .iter()
        .map(|&vertex| points[vertex] - first)
        .collect();
    let normal = null_direction(&mut rows)?;
    let offset = normal.dot(&first);
    let is_outward = normal.dot(inside) < offset;
    let sign = if is_outward { 1.0 } else { -1.0 };
    Some(Facet {
        vertices,
        normal: normal * sign,
        offset: offset * sign,
    })
}

/// Returns the unit vector that is across five others, by elimination with full pivoting.
fn null_direction(rows: &mut [Vector6<f64>]) -> Option<Vector6<f64>> {
    let mut pivots: Vec<usize> = Vec::with_capacity(N - 1);
    for done in 0..N - 1 {
        let mut best = (done, 0, 0.0_f64);
        for (idx, row) in rows.iter().enumerate().skip(done) {
            for column in (0..N).filter(|column| !pivots.contains(column)) {
                if row[column].abs() > best.2 {
                    best = (idx, column, row[column].abs());
                }
            }
        }
        let (idx, column, size) = best;
        if size <= f64::EPSILON * 1e-3 {
            return None;
        }
        rows.swap(done, idx);
        pivots.push(column);
        let pivot = rows[done] / rows[done][column];
        rows[done] = pivot;
        for (idx, row) in rows.iter_mut().enumerate() {
            if idx != done {
                let times = row[column];
                *row -= pivot * times;
            }
        }
    }
    let free = (0..N).find(|column| !pivots.contains(column))?;
    let mut normal = Vector6::zeros();
    normal[free] = 1.0;
    for (row, &column) in rows.iter().zip(&pivots) {
        normal[column] = -row[free];
    }
    normal.try_normalize(0.0)
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn cross_polytope() -> Vec<Vector6<f64>> {
        let mut points = Vec::new();
        for axis in 0..N {
            let mut along = Vector6::zeros();
            along[axis] = 1.0;
            points.extend([along, -along]);
        }
        points
    }

    #[test]
    fn regular_hulls_have_the_known_radius() {
        let radius = ball_radius(&cross_polytope()).unwrap();
        assert!((radius - 1.0 / 6.0_f64.sqrt()).abs() < 1e-6, "{radius}");
        // The cube's facets have 32 corners each.
        let corner =
            |bits: u32| Vector6::from_fn(|axis, _| if bits >> axis & 1 == 0 { -1.0 } else { 1.0 });
        let cube: Vec<Vector6<f64>> = (0..64).map(corner).collect();
        let radius = ball_radius(&cube).unwrap();
        assert!((radius - 1.0).abs() < 1e-5, "{radius}");
        let moved: Vec<Vector6<f64>> = cube
            .iter()
            .map(|point| point + Vector6::x() * 0.25)
            .collect();
        assert!((ball_radius(&moved).unwrap() - 0.75).abs() < 1e-5);
        let beyond: Vec<Vector6<f64>> = cube
            .iter()
            .map(|point| point + Vector6::x() * 1.5)
            .collect();
        assert!(ball_radius(&beyond).unwrap() < 0.0);
    }

    #[test]
    fn points_in_a_plane_have_none() {
        let flat: Vec<Vector6<f64>> = cross_polytope()
            .into_iter()
            .map(|mut point| {
                point[5] = 0.0;
                point
            })
            .collect();
        assert_eq!(ball_radius(&flat), None);
        assert_eq!(ball_radius(&[]), None);
    }

    /// Every plane through six points with all others on one side is a facet: the nearest of them is the radius.
    #[test]
    fn the_radius_is_that_of_the_nearest_of_all_facets() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for _ in 0..8 {
            let n = 12;
            let points: Vec<Vector6<f64>> = (0..n)
                .map(|_| Vector6::from_fn(|_, _| rng.random::<f64>() * 2.0 - 1.0))
                .collect();
            let mut nearest = f64::INFINITY;
            for bits in 0_u32..1 << n {
                if bits.count_ones() != 6 {
                    continue;
                }
                let chosen: Vec<usize> = (0..n).filter(|idx| bits >> idx & 1 == 1).collect();
                let mut rows: Vec<Vector6<f64>> = chosen[1..]
                    .iter()
                    .map(|&idx| points[idx] - points[chosen[0]])
                    .collect();
                let normal = null_direction(&mut rows).unwrap();
                let offset = normal.dot(&points[chosen[0]]);
                let sides: Vec<f64> = points
                    .iter()
                    .map(|point| normal.dot(point) - offset)
                    .collect();
                if sides.iter().all(|side| *side < 1e-9) {
                    nearest = nearest.min(offset);
                } else if sides.iter().all(|side| *side > -1e-9) {
                    nearest = nearest.min(-offset);
                }
            }
            let found = ball_radius(&points).unwrap();
            assert!((found - nearest).abs() < 1e-5, "{found} {nearest}");
        }
    }
}
