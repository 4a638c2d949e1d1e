//! Convex bodies: the form in which physics uses a mesh.

use nalgebra::{Point3, Vector3};

/// Least volume of a body as a share of its length cubed: less is a flat piece.
const FLAT: f64 = 1e-6;
/// Tolerance within which triangles belong to one side: on the cosine between their normals, and on
/// the distance of their planes in meters.
const ALIKE: f64 = 1e-9;

/// A convex body by its corners and the triangles of its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexBody {
    corners_m: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    sides: Vec<Side>,
}

/// The plane of one side: the body is where `normal · point ≤ offset_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Side {
    pub(crate) normal: Vector3<f64>,
    pub(crate) offset_m: f64,
}

impl Side {
    /// Returns the distance of a point beyond the plane, in meters; negative on the body's side.
    pub(crate) fn beyond(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(point) - self.offset_m
    }
}

impl ConvexBody {
    /// Takes the corners of a convex hull in meters and its triangles, counterclockwise seen from
    /// outside; `None` if they enclose no volume or a triangle names a corner that is not there.
    pub fn new(corners_m: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Option<Self> {
        let n = u32::try_from(corners_m.len()).ok()?;
        let is_there = |corner: &u32| *corner < n;
        if !triangles.iter().flatten().all(is_there)
            || !corners_m
                .iter()
                .flat_map(Point3::iter)
                .all(|x| x.is_finite())
        {
            return None;
        }
        let mut body = Self {
            corners_m,
            triangles,
            sides: Vec::new(),
        };
        let (low, high) = body.bounds();
        if body.volume_m3() <= FLAT * (high - low).norm().powi(3) {
            return None;
        }
        body.sides = body.planes();
        Some(body)
    }

    /// Returns the corners, in meters.
    pub fn corners_m(&self) -> &[Point3<f64>] {
        &self.corners_m
    }

    /// Returns the triangles of the surface, counterclockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the middle of the box about the body, in meters.
    pub fn middle_m(&self) -> Vector3<f64> {
        let (low, high) = self.bounds();
        (low + high) / 2.0
    }

    /// Returns the body moved by an offset, in meters.
    #[must_use]
    pub fn moved(&self, offset_m: &Vector3<f64>) -> Self {
        let corners = self.corners_m.iter().map(|corner| corner + offset_m);
        let sides = self.sides.iter().map(|side| Side {
            normal: side.normal,
            offset_m: side.offset_m + side.normal.dot(offset_m),
        });
        Self {
            corners_m: corners.collect(),
            triangles: self.triangles.clone(),
            sides: sides.collect(),
        }
    }

    /// Returns the planes of the sides, each once.
    pub(crate) fn sides(&self) -> &[Side] {
        &self.sides
    }

    /// Returns the corners of each triangle, in meters.
    pub(crate) fn surface(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> {
        let corner = |idx: u32| {
            let corner = usize::try_from(idx)
                .ok()
                .and_then(|idx| self.corners_m.get(idx));
            corner.map_or_else(Vector3::zeros, |corner| corner.coords)
        };
        self.triangles
            .iter()
            .map(move |triangle| triangle.map(corner))
    }

    /// Returns the corner that is farthest along a direction of any length.
    pub(crate) fn farthest(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let along = |corner: &&Point3<f64>| corner.coords.dot(direction);
        self.corners_m
            .iter()
            .max_by(|a, b| along(a).total_cmp(&along(b)))
            .map_or_else(Vector3::zeros, |corner| corner.coords)
    }

    /// Returns the center of mass of the body filled evenly, in meters.
    pub(crate) fn center_m(&self) -> Vector3<f64> {
        let middle = self.middle_m();
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for corners in self.surface() {
            let [a, b, c] = corners.map(|corner| corner - middle);
            let part = a.dot(&b.cross(&c));
            volume += part;
            moment += (a + b + c) * (part / 4.0);
        }
        middle + moment / volume
    }

    /// Returns half of the least width of the body, between one of its sides and the opposite
    /// corners, in meters.
    pub(crate) fn half_thickness_m(&self) -> f64 {
        let across = |side: &Side| -side.beyond(&self.farthest(&-side.normal));
        self.sides.iter().map(across).fold(f64::INFINITY, f64::min) / 2.0
    }

    fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        let corners = || self.corners_m.iter().map(|corner| corner.coords);
        (
            corners().reduce(|a, b| a.inf(&b)).unwrap_or_default(),
            corners().reduce(|a, b| a.sup(&b)).unwrap_or_default(),
        )
    }

    fn volume_m3(&self) -> f64 {
        let middle = self.middle_m();
        let part = |corners: [Vector3<f64>; 3]| {
            let [a, b, c] = corners.map(|corner| corner - middle);
            a.dot(&b.cross(&c)) / 6.0
        };
        self.surface().map(part).sum()
    }

    fn planes(&self) -> Vec<Side> {
        let mut sides: Vec<Side> = Vec::new();
        for [a, b, c] in self.surface() {
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(f64::MIN_POSITIVE) else {
                continue;
            };
            let offset_m = normal.dot(&a);
            let is_known = sides.iter().any(|side| {
                side.normal.dot(&normal) > 1.0 - ALIKE && (side.offset_m - offset_m).abs() < ALIKE
            });
            if !is_known {
                sides.push(Side { normal, offset_m });
            }
        }
        sides
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A box about the origin.
    pub(crate) fn cuboid(half: &Vector3<f64>) -> ConvexBody {
        let corner = |k: usize| {
            let side = |axis: usize| if k >> axis & 1 == 0 { -1.0 } else { 1.0 };
            Point3::new(side(0) * half.x, side(1) * half.y, side(2) * half.z)
        };
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let triangles = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        ConvexBody::new((0..8).map(corner).collect(), triangles.collect()).unwrap()
    }

    #[test]
    fn a_box_has_six_sides_and_its_middle_wherever_it_is() {
        let half = Vector3::new(0.01, 0.02, 0.005);
        let offset = Vector3::new(0.3, -0.1, 0.2);
        let body = cuboid(&half).moved(&offset);
        assert_eq!(body.sides().len(), 6);
        assert!((body.middle_m() - offset).norm() < 1e-12);
        assert!((body.center_m() - offset).norm() < 1e-12);
        assert!((body.half_thickness_m() - 0.005).abs() < 1e-12);
        for side in body.sides() {
            let depth = -side.beyond(&offset);
            assert!((depth - half.dot(&side.normal.abs())).abs() < 1e-12);
        }
        assert!(
            (body.farthest(&Vector3::new(1.0, -1.0, 0.1))
                - offset
                - half.component_mul(&Vector3::new(1.0, -1.0, 1.0)))
            .norm()
                < 1e-12
        );
    }

    #[test]
    fn mesh_without_volume_is_refused() {
        let body = cuboid(&Vector3::repeat(0.01));
        let (corners, triangles) = (body.corners_m.clone(), body.triangles.clone());
        assert!(ConvexBody::new(corners.clone(), triangles.clone()).is_some());
        let flat = corners
            .iter()
            .map(|corner| Point3::new(corner.x, corner.y, 0.0));
        assert!(ConvexBody::new(flat.collect(), triangles.clone()).is_none());
        assert!(
            ConvexBody::new(corners.iter().copied().take(7).collect(), triangles.clone()).is_none()
        );
        let inward = triangles.iter().map(|&[a, b, c]| [a, c, b]);
        assert!(ConvexBody::new(corners.clone(), inward.collect()).is_none());
        let endless = corners.iter().map(|corner| corner / 0.0);
        assert!(ConvexBody::new(endless.collect(), triangles).is_none());
        assert!(ConvexBody::new(Vec::new(), Vec::new()).is_none());
    }
}
