//! Convex hulls, and hulls of few vertices.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use parry3d::transformation::try_convex_hull;

use crate::{
    GeometryError, TriMesh,
    single::{double, singles},
};

/// A hull thinner than this part of its length has no volume worth the name.
const FLAT: f64 = 1e-5;

/// Returns the convex hull of points, winding outward.
pub(crate) fn convex_hull(points: &[Point3<f64>]) -> Result<TriMesh, GeometryError> {
    let flat = || GeometryError::NoHull {
        points: points.len(),
    };
    let (vertices, triangles) = try_convex_hull(&singles(points)).map_err(|_degenerate| flat())?;
    let hull = without_spare_vertices(&TriMesh {
        vertices_m: vertices.iter().map(double).collect(),
        triangles,
    });
    let (low, high) = hull.bounds();
    let length = (high - low).norm();
    // A plane's hull comes back as two sides of nothing.
    if hull.volume_m3() > FLAT * length.powi(3) {
        Ok(hull)
    } else {
        Err(flat())
    }
}

/// A point no farther than this outside a hull is on it, in meters: rounding.
pub(crate) const ON_HULL_M: f64 = 1e-6;

/// Returns at most `limit` of the points whose hull is nearly that of all: greedily, the point
/// farthest outside the hull so far, first index first, until none is farther than `tolerance_m`.
///
/// The points `kept` are among them, even if they are more than `limit`.
pub(crate) fn few_hull_points(
    points: &[Point3<f64>],
    kept: &[Point3<f64>],
    limit: usize,
    tolerance_m: f64,
) -> Result<Vec<Point3<f64>>, GeometryError> {
    let full = convex_hull(points)?;
    if full.vertices_m.len() <= limit && tolerance_m <= ON_HULL_M {
        return Ok(full.vertices_m);
    }
    let mut chosen = extremes(&full.vertices_m);
    for point in kept {
        if !chosen.contains(point) {
            chosen.push(*point);
        }
    }
    while chosen.len() < limit {
        let Ok(hull) = convex_hull(&chosen) else {
            break;
        };
        let planes: Vec<(Vector3<f64>, f64)> = hull
            .triangles
            .iter()
            .filter_map(|&triangle| {
                let normal = hull.area_normal(triangle).try_normalize(1e-15)?;
                Some((normal, normal.dot(&hull.corners(triangle)[0].coords)))
            })
            .collect();
        let outside = |point: &Point3<f64>| {
            planes
                .iter()
                .map(|(normal, offset)| normal.dot(&point.coords) - offset)
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let mut farthest = (tolerance_m, None);
        for point in &full.vertices_m {
            let distance = outside(point);
            if distance > farthest.0 {
                farthest = (distance, Some(*point));
            }
        }
        let (_, Some(point)) = farthest else { break };
        chosen.push(point);
    }
    Ok(convex_hull(&chosen)?.vertices_m)
}

/// Returns the points farthest along the axes and the diagonals.
fn extremes(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let signs = [-1.0, 0.0, 1.0];
    let mut chosen: Vec<Point3<f64>> = Vec::new();
    for (x, y, z) in triples(signs) {
        let direction = Vector3::new(x, y, z);
        // Axes and space diagonals: fourteen directions.
        if matches!(direction.iter().filter(|part| **part != 0.0).count(), 0 | 2) {
            continue;
        }
        let mut best: Option<(f64, Point3<f64>)> = None;
        for point in points {
            let reach = direction.dot(&point.coords);
            if best.is_none_or(|(most, _)| reach > most) {
                best = Some((reach, *point));
            }
        }
        if let Some((_, point)) = best
            && !chosen.contains(&point)
        {
            chosen.push(point);
        }
    }
    chosen
}

/// Returns every triple of the numbers, in order.
fn triples(numbers: [f64; 3]) -> impl Iterator<Item = (f64, f64, f64)> {
    numbers.into_iter().flat_map(move |x| {
        numbers
            .into_iter()
            .flat_map(move |y| numbers.into_iter().map(move |z| (x, y, z)))
    })
}

/// Returns the mesh with only the vertices that its triangles use.
fn without_spare_vertices(mesh: &TriMesh) -> TriMesh {
    let mut new_index: BTreeMap<u32, u32> = BTreeMap::new();
    let mut vertices_m = Vec::new();
    let triangles = mesh
        .triangles
        .iter()
        .map(|triangle| {
            triangle.map(|old| {
                *new_index.entry(old).or_insert_with(|| {
                    vertices_m.push(mesh.vertices_m[old as usize]);
                    u32::try_from(vertices_m.len() - 1).unwrap_or(u32::MAX)
                })
            })
        })
        .collect();
    TriMesh {
        vertices_m,
        triangles,
    }
}
