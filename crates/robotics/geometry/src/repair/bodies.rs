//! Bodies: triangles that are connected by edges.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::edges::Edges;
use crate::TriMesh;

/// An open body winds inward if it encloses less than minus this part of its bounds.
const ENCLOSING: f64 = 0.01;
/// An open body flatter than this part of its length cubed encloses nothing.
const FLAT: f64 = 1e-6;
/// A volume of less than this part of the length cubed may be a sum's rounding.
const NOISE: f64 = 1e-12;
/// More bodies than this are loose triangles, not parts with cavities.
const MAX_BODIES: usize = 1000;

/// The bodies of a mesh.
pub(super) struct Bodies(Vec<Body>);

struct Body {
    triangles: Vec<usize>,
    low: Point3<f64>,
    high: Point3<f64>,
    /// Whether every edge is passed as often one way as the other.
    is_closed: bool,
    /// Enclosed volume in cubic meters, about the middle of its surface.
    volume_m3: f64,
}

impl Bodies {
    pub(super) fn of(mesh: &TriMesh, edges: &Edges) -> Self {
        let mut parent: Vec<usize> = (0..mesh.triangles.len()).collect();
        for sides in edges.iter() {
            for pair in sides.windows(2) {
                if let [a, b] = pair {
                    let [a, b] = [a, b].map(|side| root(&mut parent, side.triangle));
                    if let Some(own) = parent.get_mut(a.max(b)) {
                        *own = a.min(b);
                    }
                }
            }
        }
        let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut body_of = vec![0; mesh.triangles.len()];
        for (triangle, body) in body_of.iter_mut().enumerate() {
            *body = root(&mut parent, triangle);
            members.entry(*body).or_default().push(triangle);
        }
        let mut open: BTreeSet<usize> = BTreeSet::new();
        for sides in edges.iter() {
            let ahead = sides.iter().filter(|side| side.is_ahead);
            if 2 * ahead.count() != sides.len()
                && let Some(body) = sides.first().and_then(|side| body_of.get(side.triangle))
            {
                open.insert(*body);
            }
        }
        let bodies = members.into_iter().map(|(idx, triangles)| {
            let (low, high) = bounds(mesh, &triangles);
            Body {
                is_closed: !open.contains(&idx),
                volume_m3: volume_m3(mesh, &triangles),
                triangles,
                low,
                high,
            }
        });
        Self(bodies.collect())
    }

    /// Marks the triangles of bodies that wind inward.
    pub(super) fn inward(&self, mesh: &TriMesh) -> Vec<bool> {
        let mut marked = vec![false; mesh.triangles.len()];
        let mut mark = |body: &Body| {
            for &idx in &body.triangles {
                if let Some(marked) = marked.get_mut(idx) {
                    *marked = true;
                }
            }
        };
        let is_inward = |body: &Body| body.volume_m3 < 0.0 && body.encloses();
        if self.0.iter().any(is_inward) {
            for body in &self.0 {
                if is_inward(self.around(body, mesh).unwrap_or(body)) {
                    mark(body);
                }
            }
        }
        // Loose faces of a box enclose nothing alone.
        let loose: Vec<&Body> = self.0.iter().filter(|body| !body.encloses()).collect();
        if !loose.is_empty() {
            let idxs: Vec<usize> = loose
                .iter()
                .flat_map(|body| &body.triangles)
                .copied()
                .collect();
            let (low, high) = bounds(mesh, &idxs);
            let volume_m3 = volume_m3(mesh, &idxs);
            if volume_m3 < 0.0 && is_much(volume_m3, low, high) {
                loose.into_iter().for_each(mark);
            }
        }
        marked
    }

    /// Returns the largest body that another lies inside of.
    fn around(&self, inner: &Body, mesh: &TriMesh) -> Option<&Body> {
        if self.0.len() > MAX_BODIES {
            return None;
        }
        let holds = |outer: &&Body| {
            let is_within = (0..3).all(|axis| {
                outer.low[axis] < inner.low[axis] && inner.high[axis] < outer.high[axis]
            });
            let corner = inner
                .triangles
                .first()
                .and_then(|&idx| mesh.triangles.get(idx));
            is_within
                && corner.is_some_and(|&corner| {
                    let [point, ..] = mesh.corners(corner);
                    winding_number(mesh, &outer.triangles, &point).abs() > 0.5
                })
        };
        let size = |body: &&Body| (body.high - body.low).norm();
        let around = self.0.iter().filter(holds);
        around.max_by(|a, b| size(a).total_cmp(&size(b)))
    }
}

impl Body {
    /// Says whether there is an inside.
    fn encloses(&self) -> bool {
        let least = NOISE * (self.high - self.low).norm().powi(3);
        self.is_closed && self.volume_m3.abs() > least
            || is_much(self.volume_m3, self.low, self.high)
    }
}

/// Says whether a volume is more than noise within these bounds.
fn is_much(volume_m3: f64, low: Point3<f64>, high: Point3<f64>) -> bool {
    let sides = high - low;
    volume_m3.abs() > (ENCLOSING * sides.product()).max(FLAT * sides.norm().powi(3))
}

fn root(parent: &mut [usize], of: usize) -> usize {
    let mut at = of;
    while let Some(&above) = parent.get(at)
        && above != at
    {
        let next = parent.get(above).copied().unwrap_or(above);
        if let Some(own) = parent.get_mut(at) {
            *own = next;
        }
        at = next;
    }
    at
}

fn corners<'a>(
    mesh: &'a TriMesh,
    triangles: &'a [usize],
) -> impl Iterator<Item = [Point3<f64>; 3]> + Clone + 'a {
    let named = triangles.iter().filter_map(|&idx| mesh.triangles.get(idx));
    named.map(|&triangle| mesh.corners(triangle))
}

fn bounds(mesh: &TriMesh, triangles: &[usize]) -> (Point3<f64>, Point3<f64>) {
    let mut places = corners(mesh, triangles).flatten();
    let first = places.next().unwrap_or_else(Point3::origin);
    places.fold((first, first), |(low, high), place| {
        (low.inf(&place), high.sup(&place))
    })
}

/// Returns the volume below a surface, seen from its middle.
fn volume_m3(mesh: &TriMesh, triangles: &[usize]) -> f64 {
    let corners = corners(mesh, triangles);
    let mut middle = Vector3::zeros();
    let mut area = 0.0;
    for [a, b, c] in corners.clone() {
        let own = (b - a).cross(&(c - a)).norm();
        middle += (a.coords + b.coords + c.coords) * (own / 3.0);
        area += own;
    }
    if area <= 0.0 {
        return 0.0;
    }
    let middle = Point3::from(middle / area);
    corners
        .map(|triangle| {
            let [a, b, c] = triangle.map(|corner| corner - middle);
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum()
}

/// Returns how often a surface winds around a point (Van Oosterom and Strackee, "The solid angle of
/// a plane triangle", 1983).
fn winding_number(mesh: &TriMesh, triangles: &[usize], point: &Point3<f64>) -> f64 {
    let angles = corners(mesh, triangles).map(|triangle| {
        let [a, b, c] = triangle.map(|corner| corner - point);
        let [x, y, z] = [a, b, c].map(|side| side.norm());
        let below = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    });
    angles.sum::<f64>() / (4.0 * std::f64::consts::PI)
}
