//! Signed distance to a surface, sampled on a grid: answers in nanoseconds.

use nalgebra::{Point3, Vector3};

use crate::{GeometryError, SurfaceDistance, TriMesh, winding::inside};

/// Signed distance to a closed mesh at the nodes of a grid, and between them by interpolation.
///
/// Within the grid the answer is trilinear in the eight nodes about a point: exact along flat
/// surfaces, and off by at most an eighth of the squared spacing times the curvature of the
/// distance elsewhere, which is 0.1 mm for a spacing of 3 mm one centimeter from an edge, and twice
/// that from a corner.
/// Deep inside, where two sides are equally far, it is off by up to half a spacing, and walls thinner
/// than two spacings read thinner than they are.
/// Whether a node is inside is decided by the surface's winding number around it, so that scanned
/// surfaces that fold over themselves are no trouble.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceField {
    /// The node of the least coordinates, in meters.
    least: Point3<f64>,
    /// Distance between neighboring nodes along each axis, in meters.
    spacing_m: f64,
    /// Number of nodes along x, y and z, each at least 2.
    counts: [usize; 3],
    /// The distance that the number 1 stands for, in meters.
    quantum_m: f64,
    /// Distances, negative inside; x runs fastest, then y. In 16 bits, so that a field stays in a
    /// processor's cache.
    distances: Vec<i16>,
}

/// Greatest number of nodes: 128 MiB.
const MAX_NODES: usize = 1 << 26;
/// Offset of the nodes relative to the mesh, as a share of the spacing: the round coordinates of
/// made shapes fall between them.
const SHIFT: f64 = 0.381_966;
/// Distance from the surface up to which every node is searched, in meters.
const SURE_M: f64 = 0.012;
/// First bytes of a written field.
const MAGIC: &[u8; 8] = b"sdfield1";
/// Bytes before the distances: the mark, the least node, the spacing, the quantum and the counts.
const HEADER: usize = 8 + 8 * 8;

impl DistanceField {
    /// Samples a mesh and the space about it up to `margin_m` from its bounds; `None` if it has no
    /// surface.
    ///
    /// # Errors
    ///
    /// Fails if the spacing or the margin is not a positive length, or the mesh is so large that
    /// the grid would have more than 2²⁶ nodes.
    pub fn new(
        mesh: &TriMesh,
        spacing_m: f64,
        margin_m: f64,
    ) -> Result<Option<Self>, GeometryError> {
        let is_length = |length: f64| length.is_finite() && length > 0.0;
        if !is_length(spacing_m) || !is_length(margin_m) {
            return Err(GeometryError::BadGrid {
                spacing_m,
                margin_m,
            });
        }
        let surface = SurfaceDistance::new(mesh);
        if surface.is_empty() {
            return Ok(None);
        }
        let (low, high) = mesh.bounds();
        let least = low - Vector3::repeat(margin_m + SHIFT * spacing_m);
        let room = (high - least) + Vector3::repeat(margin_m);
        let along = |length: f64| (length / spacing_m).ceil() + 1.0;
        let nodes = along(room.x) * along(room.y) * along(room.z);
        if nodes.is_nan() || nodes > MAX_NODES as f64 {
            return Err(GeometryError::LargeGrid {
                sides_m: (high - low).into(),
                spacing_m,
            });
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked against the greatest number of nodes"
        )]
        let counts = [room.x, room.y, room.z].map(|length| along(length) as usize);
        let grid = Grid {
            least,
            spacing_m,
            counts,
        };
        let inside = inside(mesh, &least, spacing_m, counts);
        let distances = grid.distances(&surface);
        let greatest = distances.iter().copied().fold(0.0, f64::max);
        let quantum_m = (greatest / f64::from(i16::MAX)).max(f64::MIN_POSITIVE);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the greatest becomes the greatest that there is"
        )]
        let quantized = |(distance, is_inside): (f64, bool)| {
            let number = (distance / quantum_m).round() as i16;
            if is_inside { -number } else { number }
        };
        Ok(Some(Self {
            least,
            spacing_m,
            counts,
            quantum_m,
            distances: distances.into_iter().zip(inside).map(quantized).collect(),
        }))
    }

    /// Returns the distance between neighboring nodes, in meters.
    pub fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// Returns the signed distance at a point, negative inside, in meters, and its gradient there.
    ///
    /// The gradient is that of the interpolation, about of length 1. Beyond the grid the way to it is
    /// added: never less than the true distance.
    // Callers that need no gradient compute none.
    #[inline]
    pub fn distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let mut cell = [0; 3];
        let mut share = [0.0; 3];
        let mut beyond = Vector3::zeros();
        for axis in 0..3 {
            let at = (point[axis] - self.least[axis]) / self.spacing_m;
            let last = (self.counts[axis] - 1) as f64;
            let within = at.clamp(0.0, last);
            beyond[axis] = (at - within) * self.spacing_m;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to the grid; NaN becomes the first node"
            )]
            // A grid has at most 2²⁶ nodes; to 64 bits the conversion takes several times as long.
            let node = (within as u32 as usize).min(self.counts[axis] - 2);
            cell[axis] = node;
            share[axis] = within - node as f64;
        }
        let [nx, ny, _] = self.counts;
        let first = cell[0] + nx * (cell[1] + ny * cell[2]);
        let along_x = |offset: usize| {
            let from = first + offset;
            match self.distances.get(from..from + 2) {
                Some(&[a, b]) => (f64::from(a), f64::from(b) - f64::from(a)),
                _ => (0.0, 0.0),
            }
        };
        let [u, v, w] = share;
        let [a, b, c, d] = [0, nx, nx * ny, nx * ny + nx].map(along_x);
        let [a_at, b_at, c_at, d_at] = [a, b, c, d].map(|(value, slope)| value + u * slope);
        let near = a_at + v * (b_at - a_at);
        let far = c_at + v * (d_at - c_at);
        let between = |p: f64, q: f64, share: f64| p + share * (q - p);
        let gradient = Vector3::new(
            between(between(a.1, b.1, v), between(c.1, d.1, v), w),
            between(b_at - a_at, d_at - c_at, w),
            far - near,
        ) * (self.quantum_m / self.spacing_m);
        let distance = (near + w * (far - near)) * self.quantum_m;
        let squared_way = beyond.norm_squared();
        if squared_way > 0.0 {
            let way = squared_way.sqrt();
            let along =
                gradient.zip_map(&beyond, |slope, way| if way == 0.0 { slope } else { 0.0 });
            return (distance + way, along + beyond / way);
        }
        (distance, gradient)
    }

    /// Returns the field as bytes, the same on every machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER + 2 * self.distances.len());
        bytes.extend_from_slice(MAGIC);
        for number in self.least.iter().chain([&self.spacing_m, &self.quantum_m]) {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        for count in self.counts {
            bytes.extend_from_slice(&(count as u64).to_le_bytes());
        }
        for distance in &self.distances {
            bytes.extend_from_slice(&distance.to_le_bytes());
        }
        bytes
    }

    /// Reads what [`DistanceField::to_bytes`] wrote; `None` if it is something else.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (header, rest) = bytes.split_at_checked(HEADER)?;
        let (magic, header) = header.split_at_checked(MAGIC.len())?;
        if magic != MAGIC {
            return None;
        }
        let (words, _) = header.as_chunks::<8>();
        let &[x, y, z, spacing, quantum, nx, ny, nz] = words else {
            return None;
        };
        let [x, y, z, spacing_m, quantum_m] = [x, y, z, spacing, quantum].map(f64::from_le_bytes);
        let counts = [nx, ny, nz].map(|count| usize::try_from(u64::from_le_bytes(count)).ok());
        let [Some(nx), Some(ny), Some(nz)] = counts else {
            return None;
        };
        let nodes = nx.checked_mul(ny)?.checked_mul(nz)?;
        let is_whole = nodes <= MAX_NODES
            && [nx, ny, nz].iter().all(|&count| count >= 2)
            && rest.len() == 2 * nodes
            && spacing_m > 0.0
            && quantum_m > 0.0
            && [x, y, z, spacing_m, quantum_m]
                .iter()
                .all(|number| number.is_finite());
        let (words, _) = rest.as_chunks::<2>();
        is_whole.then(|| Self {
            least: Point3::new(x, y, z),
            spacing_m,
            counts: [nx, ny, nz],
            quantum_m,
            distances: words.iter().map(|&word| i16::from_le_bytes(word)).collect(),
        })
    }
}

/// Positions of a field's nodes.
struct Grid {
    least: Point3<f64>,
    spacing_m: f64,
    counts: [usize; 3],
}

impl Grid {
    /// Returns each node's distance from the surface in meters, on whichever side; x runs fastest, then y.
    ///
    /// Every other node along each axis is searched. The triangles nearest to those about a node in
    /// between are nearly always its own: near the surface a search makes sure, far from it they
    /// are taken.
    fn distances(&self, surface: &SurfaceDistance) -> Vec<f64> {
        let [nx, ny, nz] = self.counts;
        let coarse = self.counts.map(|count| count.div_ceil(2));
        let at_coarse = |x: usize, y: usize, z: usize| x + coarse[0] * (y + coarse[1] * z);
        let mut faces: Vec<u32> = Vec::with_capacity(coarse.iter().product());
        let hint = |faces: &[u32], at: Option<usize>| at.and_then(|at| faces.get(at).copied());
        for z in 0..coarse[2] {
            for y in 0..coarse[1] {
                for x in 0..coarse[0] {
                    let before = [
                        x.checked_sub(1).map(|x| at_coarse(x, y, z)),
                        y.checked_sub(1).map(|y| at_coarse(x, y, z)),
                        z.checked_sub(1).map(|z| at_coarse(x, y, z)),
                    ];
                    let hints = before.into_iter().filter_map(|at| hint(&faces, at));
                    let node = self.node([2 * x, 2 * y, 2 * z]);
                    let found = surface.nearest_face(&node, hints, f64::INFINITY);
                    faces.push(found.map_or(0, |(face, _)| face));
                }
            }
        }
        let mut distances = Vec::with_capacity(nx * ny * nz);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let about = |n: usize, end: usize| [n / 2, n.div_ceil(2).min(end - 1)];
                    let [xs, ys, zs] = [
                        about(x, coarse[0]),
                        about(y, coarse[1]),
                        about(z, coarse[2]),
                    ];
                    let corners = (0..8).map(|bits: usize| {
                        at_coarse(xs[bits & 1], ys[(bits >> 1) & 1], zs[bits >> 2])
                    });
                    let hints = corners.filter_map(|at| hint(&faces, Some(at)));
                    let is_known = x % 2 == 0 && y % 2 == 0 && z % 2 == 0;
                    let sure_m = if is_known { 0.0 } else { SURE_M };
                    let found = surface.nearest_face(&self.node([x, y, z]), hints, sure_m);
                    distances.push(found.map_or(0.0, |(_, distance)| distance));
                }
            }
        }
        distances
    }

    /// Returns the place of a node.
    fn node(&self, at: [usize; 3]) -> Point3<f64> {
        self.least + Vector3::from(at.map(|count| count as f64)) * self.spacing_m
    }
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use proptest::prelude::*;

    use super::*;

    /// A box of these half sides about the origin.
    fn cuboid(half: [f64; 3]) -> TriMesh {
        let high = Point3::from(half);
        TriMesh::cuboid(-high, high)
    }

    fn field() -> &'static DistanceField {
        static FIELD: OnceLock<DistanceField> = OnceLock::new();
        FIELD.get_or_init(|| {
            let mesh = cuboid([0.03, 0.04, 0.05]);
            DistanceField::new(&mesh, 0.0025, 0.025).unwrap().unwrap()
        })
    }

    #[test]
    fn a_mesh_too_large_for_its_spacing_is_refused_with_its_size() {
        let said = |spacing_m: f64| {
            let made = DistanceField::new(&cuboid([60.0, 40.0, 0.5]), spacing_m, 0.025);
            made.err().unwrap().to_string()
        };
        assert_eq!(
            said(0.0025),
            "it measures 120 × 80 × 1 m, too large for distances every 0.0025 m; meshes are in meters, \
             and large objects need a coarser spacing"
        );
        assert_eq!(
            said(0.0),
            "spacing and margin of a distance field must be positive: 0 m, 0.025 m"
        );
    }

    /// The signed distance of a box, in closed form.
    fn exact(point: &Point3<f64>) -> f64 {
        let q = Vector3::new(
            point.x.abs() - 0.03,
            point.y.abs() - 0.04,
            point.z.abs() - 0.05,
        );
        q.map(|side| side.max(0.0)).norm() + q.max().min(0.0)
    }

    proptest! {
        /// The field is near the truth outside and at the surface, and within a spacing deep inside.
        #[test]
        fn distances_of_a_box_are_right(x in -0.05..0.05, y in -0.06..0.06, z in -0.07..0.07) {
            let field = field();
            let point = Point3::new(x, y, z);
            let (found, _) = field.distance(&point);
            let off = (found - exact(&point)).abs();
            let bound = match exact(&point) {
                far if far > 0.01 => 2e-4,
                near if near > -0.01 => 9e-4,
                _ => field.spacing_m(),
            };
            prop_assert!(off < bound, "{off} at {point}");
        }

        /// The gradient is the derivative of the distance.
        #[test]
        fn gradient_is_the_slope(at in prop::array::uniform3(-0.08..0.08)) {
            let field = field();
            let point = Point3::from(at);
            let (_, gradient) = field.distance(&point);
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-9;
                let slope = (field.distance(&(point + step)).0 - field.distance(&(point - step)).0) / 2e-9;
                let ahead = (field.distance(&(point + step)).0 - field.distance(&point).0) / 1e-9;
                let behind = (field.distance(&point).0 - field.distance(&(point - step)).0) / 1e-9;
                // On the faces between cells the slope has two values.
                prop_assume!((ahead - behind).abs() < 1e-4);
                prop_assert!((slope - gradient[axis]).abs() < 1e-4, "{slope} {gradient}");
            }
        }
    }

    #[test]
    fn bytes_come_back_as_the_field_and_nothing_else_does() {
        let field = field();
        let bytes = field.to_bytes();
        assert_eq!(DistanceField::from_bytes(&bytes), Some(field.clone()));
        assert_eq!(DistanceField::from_bytes(&bytes[..bytes.len() - 1]), None);
        assert_eq!(DistanceField::from_bytes(b"sdfield1"), None);
        let mut huge = bytes;
        huge[48..56].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(DistanceField::from_bytes(&huge), None);
    }

    #[test]
    fn a_wall_that_cuts_through_itself_has_one_inside() {
        // A thin plate whose front is dented through its back: where the dent comes out, the
        // nearest triangle faces away from those who look at it.
        let mut mesh = cuboid([0.004, 0.04, 0.05]);
        let right = |triangle: &[u32; 3]| {
            triangle
                .iter()
                .all(|&idx| mesh.vertices_m[idx as usize].x > 0.0)
        };
        let at = mesh.triangles.iter().position(right).unwrap();
        let front = mesh.triangles.remove(at);
        let dent = u32::try_from(mesh.vertices_m.len()).unwrap();
        let center = mesh
            .corners(front)
            .iter()
            .fold(Vector3::zeros(), |sum, c| sum + c.coords / 3.0);
        mesh.vertices_m.push(Point3::new(-0.02, center.y, center.z));
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            mesh.triangles.push([front[from], front[to], dent]);
        }
        let field = DistanceField::new(&mesh, 0.002, 0.03).unwrap().unwrap();
        let behind = Point3::new(-0.026, center.y, center.z);
        assert!(field.distance(&behind).0 > 0.004);
    }

    #[test]
    fn invalid_grids_are_refused() {
        let mesh = cuboid([0.03, 0.04, 0.05]);
        for (spacing_m, margin_m) in [(0.0, 0.02), (0.002, f64::NAN), (1e-6, 0.02), (0.002, 1e9)] {
            assert!(DistanceField::new(&mesh, spacing_m, margin_m).is_err());
        }
        let empty = TriMesh {
            vertices_m: Vec::new(),
            triangles: Vec::new(),
        };
        assert_eq!(DistanceField::new(&empty, 0.002, 0.02).unwrap(), None);
    }
}
