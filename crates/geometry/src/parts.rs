//! Splitting a mesh into convex parts for physics.

use std::collections::BTreeMap;

use nalgebra::Point3;
use parry3d::transformation::{
    vhacd::{VHACD, VHACDParameters},
    voxelization::FillMode,
};

use crate::{
    GeometryError, SurfaceDistance, TriMesh,
    hull::{convex_hull, few_hull_points},
    single::{double, singles},
};

/// Most vertices of one convex part: contact code slows down with more.
pub const MAX_PART_VERTICES: usize = 32;

/// A hull at most this much larger than the mesh is as good as the mesh.
const CONVEX: f64 = 1.1;

/// A hull at most this much larger is as good if the mesh has no deep dent: cans and bottles stay
/// whole, mugs and drills do not.
const NEARLY_CONVEX: f64 = 1.25;

/// A mesh with a dent deeper than this part of its shortest side is not nearly convex, however
/// little volume the dent has: a pitcher's handle.
const DEEP: f64 = 0.15;

/// Voxels along the longest side: a bowl's wall is then about one voxel.
const RESOLUTION: u32 = 64;

/// Smallest part kept, as a share of all parts' volume.
const SMALLEST_SHARE: f64 = 1e-3;

/// Returns the corners of convex bodies that together nearly fill the mesh, in meters, each with at
/// most [`MAX_PART_VERTICES`] corners: one body where the mesh is nearly convex.
///
/// Splits with VHACD (Mamou, "Volumetric hierarchical approximate convex decomposition", 2016).
///
/// # Errors
///
/// Fails if the vertices span no volume.
pub fn convex_parts(
    mesh: &TriMesh,
    max_parts: usize,
) -> Result<Vec<Vec<Point3<f64>>>, GeometryError> {
    let hull = mesh.convex_hull()?;
    let larger = hull.volume_m3() / mesh.volume_m3();
    let nearly_convex = mesh.is_watertight()
        && (larger < CONVEX
            || larger < NEARLY_CONVEX && depth_m(mesh, &hull) < DEEP * shortest_side_m(mesh));
    if max_parts <= 1 || nearly_convex {
        return Ok(vec![few_hull_points(&hull.vertices_m, MAX_PART_VERTICES)?]);
    }
    let parameters = VHACDParameters {
        resolution: RESOLUTION,
        concavity: 0.0005,
        plane_downsampling: 4,
        convex_hull_downsampling: 4,
        fill_mode: FillMode::FloodFill {
            detect_cavities: false,
        },
        // Split finer than asked, then join: a bad early cut is then undone.
        max_convex_hulls: u32::try_from(max_parts)
            .unwrap_or(u32::MAX)
            .saturating_mul(4),
        ..VHACDParameters::default()
    };
    let points = singles(&mesh.vertices_m);
    let split = VHACD::decompose(&parameters, &points, &mesh.triangles, false);
    // The voxels' corners stick out by up to a voxel: those outside go back to the surface.
    let surface = SurfaceDistance::new(mesh);
    let hulls: Vec<TriMesh> = split
        .compute_convex_hulls(1)
        .iter()
        .filter_map(|(vertices, _)| {
            let on_or_in: Vec<Point3<f64>> = vertices
                .iter()
                .map(|vertex| {
                    let vertex = double(vertex);
                    let nearest = surface.signed_distance(&vertex);
                    if nearest.distance_m > 0.0 {
                        nearest.point
                    } else {
                        vertex
                    }
                })
                .collect();
            convex_hull(&on_or_in).ok()
        })
        .collect();
    let smallest = SMALLEST_SHARE * hulls.iter().map(TriMesh::volume_m3).sum::<f64>();
    let hulls = hulls
        .into_iter()
        .filter(|part| part.volume_m3() > smallest)
        .collect();
    let parts: Vec<_> = merged(hulls, max_parts)
        .iter()
        .filter_map(|part| few_hull_points(&part.vertices_m, MAX_PART_VERTICES).ok())
        .collect();
    if parts.is_empty() {
        return Ok(vec![few_hull_points(&hull.vertices_m, MAX_PART_VERTICES)?]);
    }
    Ok(parts)
}

/// Returns how deep the deepest vertex lies below the hull, in meters.
fn depth_m(mesh: &TriMesh, hull: &TriMesh) -> f64 {
    let surface = SurfaceDistance::new(hull);
    mesh.vertices_m
        .iter()
        .map(|vertex| -surface.signed_distance(vertex).distance_m)
        .fold(0.0, f64::max)
}

/// Returns the shortest side of the bounds, in meters.
fn shortest_side_m(mesh: &TriMesh) -> f64 {
    let (low, high) = mesh.bounds();
    (high - low).min()
}

/// Joins the two bodies whose common hull adds the least volume, until at most `limit` are left:
/// VHACD's last step, which `parry3d` leaves out.
fn merged(mut bodies: Vec<TriMesh>, limit: usize) -> Vec<TriMesh> {
    let mut costs: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    let mut alive: Vec<usize> = (0..bodies.len()).collect();
    while alive.len() > limit {
        let mut best: Option<(f64, usize, usize)> = None;
        for (at, &left) in alive.iter().enumerate() {
            for &right in alive.iter().skip(at + 1) {
                let cost = *costs.entry((left, right)).or_insert_with(|| {
                    let apart = bodies[left].volume_m3() + bodies[right].volume_m3();
                    joined(&bodies[left], &bodies[right])
                        .map_or(f64::INFINITY, |hull| hull.volume_m3() - apart)
                });
                if best.is_none_or(|(least, _, _)| cost < least) {
                    best = Some((cost, left, right));
                }
            }
        }
        let hull = best.and_then(|(_, left, right)| {
            alive.retain(|&idx| idx != left && idx != right);
            joined(&bodies[left], &bodies[right])
        });
        let Some(hull) = hull else { break };
        alive.push(bodies.len());
        bodies.push(hull);
    }
    alive.iter().map(|&idx| bodies[idx].clone()).collect()
}

/// Returns the hull of two bodies.
fn joined(a: &TriMesh, b: &TriMesh) -> Option<TriMesh> {
    convex_hull(&[a.vertices_m.as_slice(), &b.vertices_m].concat()).ok()
}
