//! Splitting a mesh into convex parts for physics.

use std::collections::BTreeMap;

use nalgebra::Point3;
use parry3d::transformation::{
    vhacd::{VHACD, VHACDParameters},
    voxelization::FillMode,
};
use spatial::RestingPose;

use crate::{
    GeometryError, StablePose, SurfaceDistance, TriMesh,
    hull::{ON_HULL_M, convex_hull, few_hull_points},
    single::{double, singles},
};

/// Maximum number of vertices of one convex part: contact code slows down with more.
pub const MAX_PART_VERTICES: usize = 32;

/// A corner at most this far above the table touches it, in meters: single precision and a scan's noise.
const TOUCHES_M: f64 = 2e-5;

/// A hull at most this much larger than the mesh is as good as the mesh.
const CONVEX: f64 = 1.1;

/// A hull at most this much larger is as good if the mesh has no deep dent: cans and bottles stay
/// whole, mugs and drills do not.
const NEARLY_CONVEX: f64 = 1.25;

/// A mesh with a dent deeper than this part of its shortest side is not nearly convex, however
/// little volume the dent has: a pitcher's handle.
const DEEP: f64 = 0.15;

/// Voxels along the longest side: a bowl's wall is then about two voxels.
const RESOLUTION: u32 = 100;

/// Voxels along the longest side of coarse parts.
const COARSE_RESOLUTION: u32 = 40;

/// Maximum protrusion of a part from the mesh where more parts could follow it, in meters.
const THICKER_M: f64 = 0.002;

/// Points of a hull at which it is compared with the mesh.
const SAMPLES: usize = 60;

/// Smallest part kept, as a share of all parts' volume.
const MIN_SHARE: f64 = 1e-3;

/// Maximum number of vertices of one part that follows the mesh within a tolerance, beside those that it rests
/// on: scanned bottles need 217 for 0.1 mm.
const MAX_EXACT_VERTICES: usize = 256;

/// Returns the corners of convex bodies that together nearly fill the mesh, in meters, each with at
/// most [`MAX_PART_VERTICES`] corners: one body where the mesh is nearly convex, else as few as stick out
/// of it by no more than 2 mm, or `max_parts`.
///
/// Splits with VHACD (Mamou, "Volumetric hierarchical approximate convex decomposition", 2016), and joins
/// parts by how far their common hull lies off the mesh (Wei et al., "Approximate convex decomposition
/// for 3D meshes with collision-aware concavity and tree search", 2022, section 3), here outside of it
/// only: what is missing inside cannot push a finger away from the surface.
///
/// # Errors
///
/// Fails if the vertices span no volume.
pub fn convex_parts(
    mesh: &TriMesh,
    max_parts: usize,
) -> Result<Vec<Vec<Point3<f64>>>, GeometryError> {
    let hull = mesh.convex_hull()?;
    let few = |part: &TriMesh| few_hull_points(&part.vertices_m, &[], MAX_PART_VERTICES, ON_HULL_M);
    let parts: Vec<_> = split(mesh, &hull, max_parts)
        .iter()
        .filter_map(|part| few(part).ok())
        .collect();
    if parts.is_empty() {
        return Ok(vec![few(&hull)?]);
    }
    Ok(parts)
}

/// As [`convex_parts`], with as many corners as each part needs: no corner of the body that was cut lies farther
/// than `tolerance_m` above a face of what is left, and every corner of the mesh's hull that touches the
/// table in one of its `rests` is among them. At most 256, and those of the rests.
///
/// # Errors
///
/// Fails if the vertices span no volume.
pub fn parts_within(
    mesh: &TriMesh,
    max_parts: usize,
    tolerance_m: f64,
    rests: &[StablePose],
) -> Result<Vec<Vec<Point3<f64>>>, GeometryError> {
    let hull = mesh.convex_hull()?;
    let feet: Vec<Point3<f64>> = hull
        .vertices_m
        .iter()
        .filter(|corner| rests.iter().any(|stable| touches(&stable.rest, corner)))
        .copied()
        .collect();
    let mut parts = split(mesh, &hull, max_parts);
    if parts.is_empty() {
        parts.push(hull.clone());
    }
    let mut feet_of: Vec<Vec<Point3<f64>>> = vec![Vec::new(); parts.len()];
    let surfaces: Vec<_> = parts.iter().map(SurfaceDistance::new).collect();
    for foot in feet {
        let distance_m = |part: &usize| surfaces[*part].signed_distance(&foot).distance_m;
        let nearest = (0..parts.len()).min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        if let Some(part) = nearest {
            parts[part].vertices_m.push(foot);
            feet_of[part].push(foot);
        }
    }
    parts
        .iter()
        .zip(&feet_of)
        .map(|(part, feet)| {
            few_hull_points(&part.vertices_m, feet, MAX_EXACT_VERTICES, tolerance_m)
        })
        .collect()
}

/// As [`convex_parts`], in a tenth of the time and off by up to a fiftieth of the longest side: for a surface that is no
/// better known.
///
/// # Errors
///
/// Fails if the vertices span no volume.
pub fn coarse_parts(
    mesh: &TriMesh,
    max_parts: usize,
) -> Result<Vec<Vec<Point3<f64>>>, GeometryError> {
    let hull = mesh.convex_hull()?;
    let few = |points: &[Point3<f64>]| few_hull_points(points, &[], MAX_PART_VERTICES, ON_HULL_M);
    if max_parts <= 1 || hull.volume_m3() < CONVEX * mesh.volume_m3() {
        return Ok(vec![few(&hull.vertices_m)?]);
    }
    let parameters = VHACDParameters {
        resolution: COARSE_RESOLUTION,
        concavity: 0.01,
        plane_downsampling: 8,
        convex_hull_downsampling: 8,
        fill_mode: FillMode::FloodFill {
            detect_cavities: false,
        },
        max_convex_hulls: u32::try_from(max_parts).unwrap_or(u32::MAX),
        ..VHACDParameters::default()
    };
    let split = VHACD::decompose(
        &parameters,
        &singles(&mesh.vertices_m),
        &mesh.triangles,
        false,
    );
    let (low, high) = mesh.bounds();
    // Corners of voxels, which stick out.
    let within = |vertex: &Point3<f64>| vertex.inf(&high).sup(&low);
    let bodies: Vec<TriMesh> = split
        .compute_convex_hulls(1)
        .iter()
        .filter_map(|(vertices, _)| {
            let vertices: Vec<_> = vertices.iter().map(|v| within(&double(v))).collect();
            convex_hull(&vertices).ok()
        })
        .collect();
    // It cuts into more than it is asked for.
    let parts: Vec<_> = merged(bodies, max_parts, &SurfaceDistance::new(mesh))
        .iter()
        .filter_map(|part| few(&part.vertices_m).ok())
        .collect();
    if parts.is_empty() {
        return Ok(vec![few(&hull.vertices_m)?]);
    }
    Ok(parts)
}

/// Says whether a corner touches the table in a resting pose.
fn touches(rest: &RestingPose, corner: &Point3<f64>) -> bool {
    rest.up_in_object.dot(&corner.coords) + rest.height_m < TOUCHES_M
}

/// Returns convex bodies that together nearly fill the mesh, one where the mesh is nearly convex.
fn split(mesh: &TriMesh, hull: &TriMesh, max_parts: usize) -> Vec<TriMesh> {
    let larger = hull.volume_m3() / mesh.volume_m3();
    let nearly_convex = mesh.is_watertight()
        && (larger < CONVEX
            || larger < NEARLY_CONVEX && depth_m(mesh, hull) < DEEP * shortest_side_m(mesh));
    if max_parts <= 1 || nearly_convex {
        return vec![hull.clone()];
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
    let smallest = MIN_SHARE * hulls.iter().map(TriMesh::volume_m3).sum::<f64>();
    let hulls = hulls
        .into_iter()
        .filter(|part| part.volume_m3() > smallest)
        .collect();
    merged(hulls, max_parts, &surface)
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

/// Joins the two bodies whose common hull sticks out of the mesh least, until at most `limit` are left
/// and no two can be joined within [`THICKER_M`].
fn merged(mut bodies: Vec<TriMesh>, limit: usize, surface: &SurfaceDistance) -> Vec<TriMesh> {
    let mut costs: BTreeMap<(usize, usize), Cost> = BTreeMap::new();
    let mut alive: Vec<usize> = (0..bodies.len()).collect();
    loop {
        let mut best: Option<(Cost, usize, usize)> = None;
        for (at, &left) in alive.iter().enumerate() {
            for &right in alive.iter().skip(at + 1) {
                let cost = *costs
                    .entry((left, right))
                    .or_insert_with(|| Cost::of(&bodies[left], &bodies[right], surface));
                if best.is_none_or(|(least, _, _)| cost < least) {
                    best = Some((cost, left, right));
                }
            }
        }
        let Some((cost, left, right)) = best else {
            break;
        };
        if alive.len() <= limit && cost.thicker_m > THICKER_M {
            break;
        }
        let Some(hull) = joined(&bodies[left], &bodies[right]) else {
            break;
        };
        alive.retain(|&idx| idx != left && idx != right);
        alive.push(bodies.len());
        bodies.push(hull);
    }
    alive.iter().map(|&idx| bodies[idx].clone()).collect()
}

/// Cost of joining two bodies.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
struct Cost {
    /// Protrusion of the hull of both from the mesh, in meters, at least [`THICKER_M`] / 2.
    thicker_m: f64,
    /// The volume that it adds, in cubic meters.
    added_m3: f64,
}

impl Cost {
    const INFINITE: Self = Self {
        thicker_m: f64::INFINITY,
        added_m3: f64::INFINITY,
    };

    fn of(left: &TriMesh, right: &TriMesh, surface: &SurfaceDistance) -> Self {
        if apart_m(left, right) > THICKER_M {
            return Self::INFINITE;
        }
        let Some(hull) = joined(left, right) else {
            return Self::INFINITE;
        };
        let (points, _) = hull.sample_surface(SAMPLES, 0);
        let thicker_m = points
            .iter()
            .map(|point| surface.signed_distance(point).distance_m)
            .fold(0.5 * THICKER_M, f64::max);
        Self {
            thicker_m,
            added_m3: hull.volume_m3() - left.volume_m3() - right.volume_m3(),
        }
    }
}

/// Returns how far apart the bounds of two bodies are along the axis where they are farthest apart.
fn apart_m(left: &TriMesh, right: &TriMesh) -> f64 {
    let (left, right) = (left.bounds(), right.bounds());
    (left.0 - right.1).sup(&(right.0 - left.1)).max()
}

/// Returns the hull of two bodies.
fn joined(a: &TriMesh, b: &TriMesh) -> Option<TriMesh> {
    convex_hull(&[a.vertices_m.as_slice(), &b.vertices_m].concat()).ok()
}
