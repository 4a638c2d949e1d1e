//! Closed triangle meshes of simple solids: lofts, tubes and level sets, and the distances that level sets are of.

use std::{collections::BTreeMap, f64::consts::TAU};

use nalgebra::{Point3, Vector3};

use crate::TriMesh;

/// A closed curve of points, counterclockwise seen against the direction in which a loft advances.
pub type Ring = Vec<Point3<f64>>;

/// A mesh in the making.
#[derive(Default)]
pub struct Builder {
    vertices_m: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    /// Adds a vertex and returns its index.
    pub fn vertex(&mut self, point: Point3<f64>) -> u32 {
        self.vertices_m.push(point);
        u32::try_from(self.vertices_m.len() - 1).unwrap_or(u32::MAX)
    }

    /// Adds the vertices of a ring.
    pub fn ring(&mut self, points: &[Point3<f64>]) -> Vec<u32> {
        points.iter().map(|&point| self.vertex(point)).collect()
    }

    /// Joins two rings of equal length, except where `leave_out` says so.
    pub fn strip(&mut self, low: &[u32], high: &[u32], leave_out: &[usize]) {
        for idx in 0..low.len() {
            if leave_out.contains(&idx) {
                continue;
            }
            let next = (idx + 1) % low.len();
            self.triangles.push([low[idx], low[next], high[next]]);
            self.triangles.push([low[idx], high[next], high[idx]]);
        }
    }

    /// Closes a ring with a fan whose normal is the direction in which the loft advances.
    pub fn cap(&mut self, ring: &[u32]) {
        let sum: Vector3<f64> = ring
            .iter()
            .map(|&idx| self.vertices_m[idx as usize].coords)
            .sum();
        let center = self.vertex(Point3::from(sum / ring.len() as f64));
        for idx in 0..ring.len() {
            self.triangles
                .push([center, ring[idx], ring[(idx + 1) % ring.len()]]);
        }
    }

    /// Returns the mesh.
    pub fn build(self) -> TriMesh {
        TriMesh {
            vertices_m: self.vertices_m,
            triangles: self.triangles,
        }
    }
}

/// Returns the solid between consecutive rings of equal length, closed at both ends.
pub fn loft(rings: &[Ring]) -> TriMesh {
    let mut builder = Builder::default();
    let rings: Vec<Vec<u32>> = rings.iter().map(|ring| builder.ring(ring)).collect();
    for (low, high) in rings.iter().zip(rings.iter().skip(1)) {
        builder.strip(low, high, &[]);
    }
    if let (Some(first), Some(last)) = (rings.first(), rings.last()) {
        let mut backwards = first.clone();
        backwards.reverse();
        builder.cap(&backwards);
        builder.cap(last);
    }
    builder.build()
}

/// Returns a horizontal rounded rectangle with half sides `a` and `b`, corner radius `r`, at height
/// `z`, all in meters.
pub fn rounded_rectangle(a: f64, b: f64, r: f64, z: f64) -> Ring {
    /// Points per corner and per side between corners.
    const ARC: u32 = 4;
    const SIDE: u32 = 4;
    let mut ring = Ring::new();
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    for (quarter, (sx, sy)) in (0_u32..).zip(corners) {
        for step in 0..=ARC {
            let angle = TAU / 4.0 * (f64::from(quarter) + f64::from(step) / f64::from(ARC));
            ring.push(Point3::new(
                sx * (a - r) + r * angle.cos(),
                sy * (b - r) + r * angle.sin(),
                z,
            ));
        }
    }
    // Split the long sides, so that no triangle is a needle.
    let n = ring.len();
    let corner_points = ARC as usize + 1;
    let mut split = Ring::new();
    for idx in 0..n {
        split.push(ring[idx]);
        if (idx + 1) % corner_points == 0 {
            let (from, to) = (ring[idx], ring[(idx + 1) % n]);
            split.extend((1..SIDE).map(|k| from + (to - from) * (f64::from(k) / f64::from(SIDE))));
        }
    }
    split
}

/// Returns a horizontal ellipse with half axes `a` and `b` at height `z`; `squareness` 2 is an
/// ellipse, more is closer to a rectangle.
pub fn ellipse(a: f64, b: f64, squareness: f64, z: f64, n: u32) -> Ring {
    (0..n)
        .map(|idx| {
            let (sin, cos) = (TAU * f64::from(idx) / f64::from(n)).sin_cos();
            let scale =
                (cos.abs().powf(squareness) + sin.abs().powf(squareness)).powf(-1.0 / squareness);
            Point3::new(a * scale * cos, b * scale * sin, z)
        })
        .collect()
}

/// Returns a ring about `center` in the plane of `u` and `v`, whose cross product is the direction
/// in which the loft advances.
pub fn oriented_ellipse(center: Point3<f64>, u: Vector3<f64>, v: Vector3<f64>, n: u32) -> Ring {
    (0..n)
        .map(|idx| {
            let (sin, cos) = (TAU * f64::from(idx) / f64::from(n)).sin_cos();
            center + u * cos + v * sin
        })
        .collect()
}

/// Returns the surface where `distance_m` is zero, inside the box from `low` to `high`, as naive
/// surface nets (Gibson, "Constrained elastic surface nets", 1998) moved onto the level set.
pub fn level_set(
    distance_m: impl Fn(&Point3<f64>) -> f64,
    low: Point3<f64>,
    high: Point3<f64>,
    cell_m: f64,
) -> TriMesh {
    let grid = Grid::sampled(&distance_m, low, high, cell_m);
    grid.net(|middle, _| onto_level(&distance_m, middle, cell_m))
}

/// As [`level_set`], of the function interpolated between the corners of each cell: a tenth of the evaluations, and for
/// functions without a gradient.
pub fn sampled_level_set(
    distance_m: impl Fn(&Point3<f64>) -> f64,
    low: Point3<f64>,
    high: Point3<f64>,
    cell_m: f64,
) -> TriMesh {
    let grid = Grid::sampled(&distance_m, low, high, cell_m);
    grid.net(|middle, cell| grid.crossing(cell).unwrap_or(middle))
}

/// Values at the nodes of a grid.
struct Grid {
    low: Point3<f64>,
    cell_m: f64,
    counts: [usize; 3],
    /// The last axis runs fastest.
    values: Vec<f64>,
}

/// The corner of the least coordinates of a cell.
type Cell = (usize, usize, usize);

impl Grid {
    fn sampled(
        distance_m: impl Fn(&Point3<f64>) -> f64,
        low: Point3<f64>,
        high: Point3<f64>,
        cell_m: f64,
    ) -> Self {
        let n = ((high - low) / cell_m).map(f64::ceil);
        let count = |x: f64| (0..=400_i32).take_while(|&i| f64::from(i) <= x).count();
        let counts = [count(n.x), count(n.y), count(n.z)];
        let mut grid = Self {
            low,
            cell_m,
            counts,
            values: Vec::with_capacity(counts.iter().product()),
        };
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                for k in 0..counts[2] {
                    grid.values.push(distance_m(&grid.node((i, j, k))));
                }
            }
        }
        grid
    }

    fn node(&self, (i, j, k): Cell) -> Point3<f64> {
        self.low + Vector3::new(i as f64, j as f64, k as f64) * self.cell_m
    }

    fn value(&self, (i, j, k): Cell) -> f64 {
        self.values[(i * self.counts[1] + j) * self.counts[2] + k]
    }

    /// Returns the mean of the points at which the edges of a cell cross zero; `None` if none does.
    fn crossing(&self, (i, j, k): Cell) -> Option<Point3<f64>> {
        let corner = |bits: usize| (i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2 & 1));
        let (mut sum, mut n) = (Vector3::zeros(), 0.0);
        for from in 0..8 {
            for axis in [1, 2, 4] {
                if from & axis != 0 {
                    continue;
                }
                let ends = [corner(from), corner(from | axis)];
                let [here, there] = ends.map(|end| self.value(end));
                if (here < 0.0) == (there < 0.0) {
                    continue;
                }
                // Without a value where nothing is known, the middle.
                let share = here / (here - there);
                let share = if share.is_finite() { share } else { 0.5 };
                let [from, to] = ends.map(|end| self.node(end).coords);
                sum += from + (to - from) * share;
                n += 1.0;
            }
        }
        (n > 0.0).then(|| Point3::from(sum / n))
    }

    /// Returns the net of the cells in which the sign changes, a vertex in each: `vertex` places it, given the cell's middle.
    fn net(&self, vertex: impl Fn(Point3<f64>, Cell) -> Point3<f64>) -> TriMesh {
        let [nx, ny, nz] = self.counts;
        let axes = [(1, 0, 0), (0, 1, 0), (0, 0, 1)];
        let mut quads = Vec::new();
        for i in 1..nx - 1 {
            for j in 1..ny - 1 {
                for k in 1..nz - 1 {
                    let here = self.value((i, j, k));
                    for (axis, (di, dj, dk)) in axes.into_iter().enumerate() {
                        let there = self.value((i + di, j + dj, k + dk));
                        if (here < 0.0) == (there < 0.0) {
                            continue;
                        }
                        let (ui, uj, uk) = axes[(axis + 1) % 3];
                        let (vi, vj, vk) = axes[(axis + 2) % 3];
                        let mut quad = [
                            (i, j, k),
                            (i - ui, j - uj, k - uk),
                            (i - ui - vi, j - uj - vj, k - uk - vk),
                            (i - vi, j - vj, k - vk),
                        ];
                        if here >= 0.0 {
                            quad.reverse();
                        }
                        quads.push(quad);
                    }
                }
            }
        }
        let mut builder = Builder::default();
        let mut vertex_of: BTreeMap<Cell, u32> = BTreeMap::new();
        for quad in quads {
            let corners = quad.map(|cell| {
                *vertex_of.entry(cell).or_insert_with(|| {
                    let middle = self.node(cell) + Vector3::repeat(self.cell_m / 2.0);
                    builder.vertex(vertex(middle, cell))
                })
            });
            let [a, b, c, d] = corners;
            builder.triangles.push([a, b, c]);
            builder.triangles.push([a, c, d]);
        }
        builder.build()
    }
}

/// Moves a cell's middle onto the level set, not out of the cell's neighborhood.
fn onto_level(
    distance_m: impl Fn(&Point3<f64>) -> f64,
    middle: Point3<f64>,
    cell_m: f64,
) -> Point3<f64> {
    let step = 1e-5;
    let mut point = middle;
    for _ in 0..6 {
        let gradient = Vector3::from_fn(|axis, _| {
            let mut offset = Vector3::zeros();
            offset[axis] = step;
            (distance_m(&(point + offset)) - distance_m(&(point - offset))) / (2.0 * step)
        });
        let size = gradient.norm_squared().max(0.1);
        point -= gradient * (distance_m(&point) / size);
    }
    let moved = (point - middle).map(|x| x.clamp(-0.75 * cell_m, 0.75 * cell_m));
    middle + moved
}

/// Distance to the hull of two balls, nearly: a cone with round ends.
pub fn tapered(p: &Point3<f64>, a: Point3<f64>, b: Point3<f64>, ra: f64, rb: f64) -> f64 {
    let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    (a + (b - a) * along - p).norm() - (ra + (rb - ra) * along)
}

/// Distance to a box with rounded edges, about the origin.
pub fn rounded_box(p: &Point3<f64>, half: Vector3<f64>, edge: f64) -> f64 {
    let beyond = p.coords.abs() - half.add_scalar(-edge);
    beyond.map(|x| x.max(0.0)).norm() + beyond.max().min(0.0) - edge
}

/// The smaller of two distances with a fillet of the given size.
pub fn smooth_min(a: f64, b: f64, size: f64) -> f64 {
    let near = (size - (a - b).abs()).max(0.0) / size;
    a.min(b) - near * near * size / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lofts_and_level_sets_are_closed_and_wind_outward() {
        let brick = loft(&[
            rounded_rectangle(0.02, 0.03, 0.004, -0.05),
            rounded_rectangle(0.02, 0.03, 0.004, 0.05),
        ]);
        let ball = level_set(
            |p| p.coords.norm() - 0.04,
            Point3::new(-0.06, -0.06, -0.06),
            Point3::new(0.06, 0.06, 0.06),
            0.006,
        );
        let sampled = sampled_level_set(
            |p| p.coords.norm() - 0.04,
            Point3::new(-0.06, -0.06, -0.06),
            Point3::new(0.06, 0.06, 0.06),
            0.006,
        );
        let ball_m3 = 4.189 * 0.04_f64.powi(3);
        for (mesh, volume) in [
            (brick, 0.04 * 0.06 * 0.1),
            (ball, ball_m3),
            (sampled, ball_m3),
        ] {
            assert!(mesh.is_watertight());
            assert!(
                (mesh.volume_m3() / volume - 1.0).abs() < 0.03,
                "{}",
                mesh.volume_m3()
            );
        }
    }
}
