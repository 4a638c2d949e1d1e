//! Signed distance to a mesh's surface.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use parry3d::{
    math::Vector,
    query::{PointQueryWithLocation, Ray, RayCast},
    shape::TriMesh as Tree,
};

use crate::{
    TriMesh,
    single::{single, singles},
};

/// The nearest point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestPoint {
    /// Distance in meters, negative inside.
    pub distance_m: f64,
    /// The nearest point, in meters.
    pub point: Point3<f64>,
    /// Outward unit normal there; on an edge or corner the one that tells inside from outside.
    pub normal: Vector3<f64>,
}

/// A closed mesh prepared for questions of distance.
///
/// The nearest triangle comes from a tree in `f32`, the nearest point on it is found in `f64`, and
/// the sign by angle-weighted pseudo-normals (Bærentzen and Aanæs, "Signed distance computation
/// using the angle weighted pseudonormal", 2005), which are right at edges and corners where a
/// triangle's own normal is not.
/// Where scanned surfaces fold over themselves they are wrong too: if the triangles around an edge
/// or corner disagree, the side of the surface that most of five rays hit first decides.
pub struct SurfaceDistance {
    /// `None` where no triangle has an area.
    tree: Option<Tree>,
    faces: Vec<Face>,
    /// Edges and corners.
    creases: Vec<Crease>,
}

/// A triangle.
struct Face {
    corners: [Point3<f64>; 3],
    normal: Vector3<f64>,
    /// Creases of the edges from corner 0 to 1, 1 to 2 and 2 to 0.
    edges: [usize; 3],
    /// Creases of the corners.
    vertices: [usize; 3],
}

/// An edge or a corner.
#[derive(Default)]
struct Crease {
    /// The pseudo-normal, not of unit length.
    normal: Vector3<f64>,
    /// The normals of the triangles around it.
    around: Vec<Vector3<f64>>,
}

/// The part of a triangle that a point is nearest to.
enum Feature {
    Interior,
    Crease(usize),
}

impl SurfaceDistance {
    /// Prepares a mesh; it should be closed and wind outward, or the sign means nothing.
    pub fn new(mesh: &TriMesh) -> Self {
        let place = mesh.welded();
        let solid: Vec<([u32; 3], Vector3<f64>)> = mesh
            .triangles
            .iter()
            .filter_map(|&triangle| {
                let normal = mesh.area_normal(triangle).try_normalize(1e-18)?;
                Some((triangle.map(|idx| place[idx as usize]), normal))
            })
            .collect();
        let triangles: Vec<[u32; 3]> = solid.iter().map(|&(triangle, _)| triangle).collect();
        let tree = Tree::new(singles(&mesh.vertices_m), triangles).ok();

        // A corner is an edge from a vertex to itself.
        let mut crease_of: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        let mut creases: Vec<Crease> = Vec::new();
        let mut add = |from: u32, to: u32, normal: Vector3<f64>, weight: f64| {
            let idx = *crease_of
                .entry((from.min(to), from.max(to)))
                .or_insert_with(|| {
                    creases.push(Crease::default());
                    creases.len() - 1
                });
            creases[idx].normal += normal * weight;
            creases[idx].around.push(normal);
            idx
        };
        let faces = solid
            .iter()
            .map(|&(triangle, normal)| {
                let [a, b, c] = triangle;
                Face {
                    corners: mesh.corners(triangle),
                    normal,
                    edges: [(a, b), (b, c), (c, a)].map(|(from, to)| add(from, to, normal, 1.0)),
                    vertices: [[a, b, c], [b, c, a], [c, a, b]].map(|turned| {
                        let [apex, next, last] = mesh.corners(turned);
                        let angle = (next - apex).angle(&(last - apex));
                        add(turned[0], turned[0], normal, angle)
                    }),
                }
            })
            .collect();
        Self {
            tree,
            faces,
            creases,
        }
    }

    /// Returns the nearest surface point, with the distance negative inside; infinitely far above
    /// the point itself if the mesh has no area.
    pub fn signed_distance(&self, point: &Point3<f64>) -> NearestPoint {
        let nearest = self.tree.as_ref().and_then(|tree| {
            let (_, (idx, _)) = tree.project_local_point_and_get_location(single(point), false);
            self.faces.get(idx as usize)
        });
        let Some(face) = nearest else {
            return NearestPoint {
                distance_m: f64::INFINITY,
                point: *point,
                normal: Vector3::z(),
            };
        };
        let (on_surface, feature) = face.nearest(point);
        let offset = point - on_surface;
        let (normal, inside) = match feature {
            Feature::Interior => (face.normal, offset.dot(&face.normal) < 0.0),
            Feature::Crease(idx) => {
                let crease = &self.creases[idx];
                let normal = crease.normal.try_normalize(1e-9).unwrap_or(face.normal);
                let behind = |normal: &Vector3<f64>| offset.dot(normal) < -1e-9;
                let before = |normal: &Vector3<f64>| offset.dot(normal) > 1e-9;
                let disputed = crease.around.iter().any(behind) && crease.around.iter().any(before);
                let inside = if disputed && offset.norm() > TOUCHING_M {
                    self.most_rays_leave(point)
                } else {
                    offset.dot(&normal) < 0.0
                };
                (normal, inside)
            }
        };
        let distance = offset.norm();
        NearestPoint {
            distance_m: if inside { -distance } else { distance },
            point: on_surface,
            normal,
        }
    }

    /// Says whether there is no surface to be near to.
    pub(crate) fn is_empty(&self) -> bool {
        self.tree.is_none()
    }

    /// Returns the triangle nearest to a point and the distance to it, on whichever side, in meters,
    /// right to a ten-thousandth; `None` if there is no surface.
    ///
    /// `hints` are triangles that may be the nearest one, e.g. those nearest to neighboring points:
    /// the search then has only to show that there is none nearer. It is left out where the best of
    /// them is farther than `sure_m`.
    pub(crate) fn nearest_face(
        &self,
        point: &Point3<f64>,
        hints: impl IntoIterator<Item = u32>,
        sure_m: f64,
    ) -> Option<(u32, f64)> {
        let tree = self.tree.as_ref()?;
        let to_face = |idx: u32| {
            let face = self.faces.get(idx as usize)?;
            Some((idx, (point - face.nearest(point).0).norm()))
        };
        let mut best: Option<(u32, f64)> = None;
        for hint in hints {
            if best.is_none_or(|(idx, _)| idx != hint)
                && let Some(found) = to_face(hint)
                && best.is_none_or(|(_, distance)| found.1 < distance)
            {
                best = Some(found);
            }
        }
        if best.is_some_and(|(_, distance)| distance > sure_m) {
            return best;
        }
        // Only what is nearer by more than single precision can tell is worth finding.
        #[expect(clippy::cast_possible_truncation, reason = "made a little smaller")]
        let reach = best.map_or(f32::MAX, |(_, distance)| {
            (0.9999 * distance - 1e-7).max(0.0) as f32
        });
        let nearer =
            tree.project_local_point_and_get_location_with_max_dist(single(point), false, reach);
        nearer.and_then(|(_, (idx, _))| to_face(idx)).or(best)
    }

    /// Says whether most rays from a point first hit the inner side of the surface.
    fn most_rays_leave(&self, point: &Point3<f64>) -> bool {
        let Some(tree) = &self.tree else { return false };
        let leaving = RAYS
            .iter()
            .filter(|direction| {
                let ray = Ray::new(single(point), Vector::from_array(**direction));
                let hit = tree.cast_local_ray_and_get_normal(&ray, f32::MAX, false);
                let face = hit.and_then(|hit| self.faces.get(hit.subshape as usize));
                face.is_some_and(|face| {
                    let [x, y, z] = direction.map(f64::from);
                    face.normal.dot(&Vector3::new(x, y, z)) > 0.0
                })
            })
            .count();
        2 * leaving > RAYS.len()
    }
}

/// Points nearer than this keep the pseudo-normal's sign: rays in `f32` could not tell.
const TOUCHING_M: f64 = 1e-6;
/// Directions of the rays that decide, off every plane that an object is likely to have.
const RAYS: [[f32; 3]; 5] = [
    [0.211, 0.347, 0.914],
    [-0.893, 0.127, 0.432],
    [0.317, -0.911, 0.264],
    [0.683, 0.516, -0.517],
    [-0.437, -0.621, -0.651],
];

impl Face {
    /// Returns the triangle's point nearest to `p` and the feature it lies on
    /// (Ericson, "Real-time collision detection", 2005, §5.1.5).
    fn nearest(&self, p: &Point3<f64>) -> (Point3<f64>, Feature) {
        let [a, b, c] = self.corners;
        let (ab, ac, ap) = (b - a, c - a, p - a);
        let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return (a, Feature::Crease(self.vertices[0]));
        }
        let bp = p - b;
        let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
        if d3 >= 0.0 && d4 <= d3 {
            return (b, Feature::Crease(self.vertices[1]));
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return (a + ab * (d1 / (d1 - d3)), Feature::Crease(self.edges[0]));
        }
        let cp = p - c;
        let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
        if d6 >= 0.0 && d5 <= d6 {
            return (c, Feature::Crease(self.vertices[2]));
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return (a + ac * (d2 / (d2 - d6)), Feature::Crease(self.edges[2]));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return (b + (c - b) * along, Feature::Crease(self.edges[1]));
        }
        let scale = 1.0 / (va + vb + vc);
        (a + ab * (vb * scale) + ac * (vc * scale), Feature::Interior)
    }
}
