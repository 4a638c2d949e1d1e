//! A triangle mesh and what follows from its triangles alone.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use crate::GeometryError;

/// A surface of triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    /// Corners, in meters.
    pub vertices_m: Vec<Point3<f64>>,
    /// Three vertex indices per triangle, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Returns a box from the corner `low` to the corner `high`, in meters.
    ///
    /// Corner k is on the high side along x, y, z where bit 0, 1, 2 of k is set.
    pub fn cuboid(low: Point3<f64>, high: Point3<f64>) -> Self {
        let corner = |k: usize| {
            let side = |axis: usize| if k >> axis & 1 == 0 { low } else { high };
            Point3::new(side(0).x, side(1).y, side(2).z)
        };
        Self {
            vertices_m: (0..8).map(corner).collect(),
            triangles: vec![
                [0, 2, 1],
                [1, 2, 3],
                [4, 5, 6],
                [5, 7, 6],
                [0, 1, 4],
                [1, 5, 4],
                [2, 6, 3],
                [3, 6, 7],
                [0, 4, 2],
                [2, 4, 6],
                [1, 3, 5],
                [3, 7, 5],
            ],
        }
    }

    /// Returns the corners of a triangle, in meters.
    ///
    /// # Panics
    ///
    /// Panics if the triangle names a vertex that the mesh does not have.
    pub fn corners(&self, triangle: [u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|idx| self.vertices_m[idx as usize])
    }

    /// Returns the smallest and the largest coordinates, in meters; zeros without vertices.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let Some(first) = self.vertices_m.first() else {
            return (Point3::origin(), Point3::origin());
        };
        self.vertices_m
            .iter()
            .fold((*first, *first), |(low, high), vertex| {
                (low.inf(vertex), high.sup(vertex))
            })
    }

    /// Returns the enclosed volume in cubic meters, negative where the mesh winds inward.
    ///
    /// Meaningful only for closed meshes; measured about the middle of the bounds, so that a small
    /// hole does little harm.
    pub fn volume_m3(&self) -> f64 {
        let middle = self.middle();
        self.triangles
            .iter()
            .map(|&triangle| {
                let [a, b, c] = self.corners(triangle).map(|corner| corner - middle);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum()
    }

    /// Says whether every edge is shared by two triangles that wind alike, with vertices at equal
    /// places taken as one.
    pub fn is_watertight(&self) -> bool {
        let place = self.welded();
        let mut balance: BTreeMap<(u32, u32), (u32, u32)> = BTreeMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|idx| place[idx as usize]);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if from == to {
                    continue;
                }
                let sides = balance.entry((from.min(to), from.max(to))).or_default();
                if from < to {
                    sides.0 += 1;
                } else {
                    sides.1 += 1;
                }
            }
        }
        !balance.is_empty() && balance.values().all(|(ahead, back)| ahead == back)
    }

    /// Returns the smallest convex mesh around the vertices.
    ///
    /// # Errors
    ///
    /// Fails if the vertices span no volume.
    pub fn convex_hull(&self) -> Result<Self, GeometryError> {
        crate::hull::convex_hull(&self.vertices_m)
    }

    /// Returns the convex hull of at most `corners_n` vertices, chosen so that all others lie in it or near to it; none is
    /// added for one that is no farther than `tolerance_m` outside.
    ///
    /// # Errors
    ///
    /// Fails if the vertices span no volume.
    pub fn few_hull(&self, corners_n: usize, tolerance_m: f64) -> Result<Self, GeometryError> {
        let corners = crate::hull::few_hull_points(&self.vertices_m, &[], corners_n, tolerance_m)?;
        crate::hull::convex_hull(&corners)
    }

    /// Returns the mesh with its coordinates multiplied along each axis, mirrored where a factor is
    /// negative.
    #[must_use]
    pub fn scaled(&self, factors: &Vector3<f64>) -> Self {
        let vertices = self.vertices_m.iter();
        let mut scaled = Self {
            vertices_m: vertices
                .map(|vertex| vertex.coords.component_mul(factors).into())
                .collect(),
            triangles: self.triangles.clone(),
        };
        if factors.product() < 0.0 {
            scaled.turn();
        }
        scaled
    }

    /// Turns every triangle's back to the front.
    fn turn(&mut self) {
        for triangle in &mut self.triangles {
            triangle.swap(1, 2);
        }
    }

    /// Returns, for each vertex, the index of the first vertex at the same place.
    pub(crate) fn welded(&self) -> Vec<u32> {
        let mut first: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        (0_u32..)
            .zip(&self.vertices_m)
            .map(|(idx, vertex)| {
                // `+ 0.0` makes −0 equal to 0.
                let key = [vertex.x, vertex.y, vertex.z].map(|x| (x + 0.0).to_bits());
                *first.entry(key).or_insert(idx)
            })
            .collect()
    }

    /// Returns the middle of the bounds, in meters.
    pub(crate) fn middle(&self) -> Point3<f64> {
        let (low, high) = self.bounds();
        nalgebra::center(&low, &high)
    }

    /// Returns a triangle's normal scaled by twice its area, in square meters.
    pub(crate) fn area_normal(&self, triangle: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }
}
