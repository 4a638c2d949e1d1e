//! Stable resting orientations of a body on a table.

use std::collections::BTreeMap;

use nalgebra::{Point3, Unit, Vector3};
use spatial::RestingPose;

use crate::TriMesh;

/// A resting orientation and how likely a random drop ends in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StablePose {
    /// Up direction and height of the mesh's origin.
    pub rest: RestingPose,
    /// Share of random drops that end so; the shares sum to one.
    pub probability: f64,
}

/// Rests closer than this, in radians, count as one: scanned faces are not quite flat.
const SAME_REST_RAD: f64 = 0.2;
/// Rests less likely than this are bumps of the mesh, not ways to lie.
const MIN_PROBABILITY: f64 = 0.005;
/// Tolerance for a center of mass outside the edge of the facet that it rests on, in meters.
const EDGE_TOLERANCE_M: f64 = 1e-5;
/// Tolerance for a center of mass that rounding puts beyond a facet, in meters.
const INSIDE_M: f64 = 1e-6;

/// A facet of the hull as a floor to lie on.
struct Floor {
    /// Outward normal, in the mesh's frame.
    normal: Vector3<f64>,
    /// Height of the center of mass above it, in meters.
    height_m: f64,
    /// Solid angle as seen from the center of mass, as a share of the full sphere.
    share: f64,
    /// The facet onto which the body rolls; `None` where it stays.
    rolls_to: Option<usize>,
}

/// Returns the orientations in which a body rests on a table, most likely first.
///
/// A body dropped in a random orientation lands on the hull's facet under its center of mass and
/// rolls over edges until the center is above the facet it lies on (Goldberg et al., "Part pose
/// statistics", 1999): the probability of a rest is the solid angle of all facets that end in it.
/// Nearly equal rests are merged, unlikely ones left out. Empty if the vertices span no volume or
/// the center of mass is outside the hull.
pub fn stable_rests(mesh: &TriMesh, center_of_mass_m: &Point3<f64>) -> Vec<StablePose> {
    let Ok(hull) = mesh.convex_hull() else {
        return Vec::new();
    };
    let floors = floors(&hull, center_of_mass_m);
    if floors.iter().any(|floor| floor.height_m < -INSIDE_M) {
        return Vec::new();
    }
    let mut share_of: BTreeMap<usize, f64> = BTreeMap::new();
    for start in 0..floors.len() {
        let mut at = start;
        // Heights only fall along the way, so that it ends.
        while let Some(next) = floors[at].rolls_to {
            at = next;
        }
        *share_of.entry(at).or_default() += floors[start].share;
    }
    let mut ends: Vec<(usize, f64)> = share_of.into_iter().collect();
    ends.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));

    let mut rests: Vec<StablePose> = Vec::new();
    for (end, probability) in ends {
        let up = -floors[end].normal;
        let near = rests
            .iter_mut()
            .find(|known| known.rest.up_in_object.angle(&up) < SAME_REST_RAD);
        if let Some(known) = near {
            known.probability += probability;
        } else {
            rests.push(StablePose {
                rest: on_table(mesh, up),
                probability,
            });
        }
    }
    rests.retain(|rest| rest.probability >= MIN_PROBABILITY);
    rests.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let sum: f64 = rests.iter().map(|rest| rest.probability).sum();
    for rest in &mut rests {
        rest.probability /= sum;
    }
    rests
}

/// Returns the rest with the given up direction, with the lowest vertex on the table.
fn on_table(mesh: &TriMesh, up: Vector3<f64>) -> RestingPose {
    let lowest = mesh
        .vertices_m
        .iter()
        .map(|vertex| up.dot(&vertex.coords))
        .fold(f64::INFINITY, f64::min);
    RestingPose {
        up_in_object: Unit::new_normalize(up),
        height_m: -lowest,
    }
}

/// Returns every facet of a hull as a floor, with the way the body rolls from it.
fn floors(hull: &TriMesh, center: &Point3<f64>) -> Vec<Floor> {
    let mut facet_of_edge: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for (idx, &[a, b, c]) in hull.triangles.iter().enumerate() {
        for edge in [(a, b), (b, c), (c, a)] {
            facet_of_edge.insert(edge, idx);
        }
    }
    let mut floors: Vec<Floor> = hull
        .triangles
        .iter()
        .map(|&triangle| {
            let corners = hull.corners(triangle);
            // A sliver has no direction of its own: it is passed over by its height.
            let normal = hull.area_normal(triangle).try_normalize(1e-14);
            Floor {
                normal: normal.unwrap_or_else(Vector3::z),
                height_m: normal.map_or(f64::INFINITY, |n| n.dot(&(corners[0] - center))),
                share: solid_angle(&corners, center) / (4.0 * std::f64::consts::PI),
                rolls_to: None,
            }
        })
        .collect();
    for (idx, &[a, b, c]) in hull.triangles.iter().enumerate() {
        let here = &floors[idx];
        let lower = [(a, b), (b, c), (c, a)]
            .into_iter()
            .filter_map(|(from, to)| {
                let outside = if here.height_m.is_finite() {
                    let start = hull.vertices_m[from as usize];
                    let along = (hull.vertices_m[to as usize] - start).try_normalize(0.0)?;
                    along.cross(&here.normal).dot(&(center - start))
                } else {
                    f64::INFINITY
                };
                let next = *facet_of_edge.get(&(to, from))?;
                let falls = floors[next].height_m < here.height_m;
                (outside > EDGE_TOLERANCE_M && falls).then_some((outside, next))
            })
            // Over the edge that the center of mass is farthest beyond.
            .max_by(|a, b| a.0.total_cmp(&b.0));
        floors[idx].rolls_to = lower.map(|(_, next)| next);
    }
    floors
}

/// Returns the solid angle of a triangle seen from a point inside the hull, in steradians
/// (van Oosterom and Strackee, "The solid angle of a plane triangle", 1983).
fn solid_angle(corners: &[Point3<f64>; 3], from: &Point3<f64>) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - from);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let numerator = a.dot(&b.cross(&c));
    let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * numerator.atan2(denominator)
}
