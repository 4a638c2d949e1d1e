//! Random points on a mesh's surface.

use nalgebra::{Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::TriMesh;

impl TriMesh {
    /// Returns `n` points spread over the surface by area, with the outward unit normals there.
    ///
    /// Points are in meters; equal seeds give equal points. The result is empty if the surface has
    /// no area.
    pub fn sample_surface(&self, n: usize, seed: u64) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let mut area = 0.0;
        let areas: Vec<f64> = self
            .triangles
            .iter()
            .map(|&triangle| {
                area += self.area_normal(triangle).norm();
                area
            })
            .collect();
        if area <= 0.0 || area.is_nan() {
            return (Vec::new(), Vec::new());
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n)
            .map(|_| {
                let target = rng.random::<f64>() * area;
                let idx = areas
                    .partition_point(|&up_to| up_to <= target)
                    .min(areas.len() - 1);
                let triangle = self.triangles[idx];
                let [a, b, c] = self.corners(triangle);
                // Uniform in a triangle: Osada et al., "Shape distributions", 2002, §4.2.
                let (root, v) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
                let point =
                    a.coords * (1.0 - root) + b.coords * (root * (1.0 - v)) + c.coords * (root * v);
                let normal = self
                    .area_normal(triangle)
                    .try_normalize(0.0)
                    .unwrap_or_else(Vector3::z);
                (Point3::from(point), normal)
            })
            .unzip()
    }
}
