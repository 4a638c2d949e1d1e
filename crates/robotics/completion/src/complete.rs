//! Closing a shape on the side that no camera saw.

use std::collections::BTreeMap;

use geometry::{TriMesh, solid::sampled_level_set};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{CompletionError, Observation, superquadric::Superquadric, symmetry::symmetries};

/// Cells of a hull of which a camera saw more to be free than this are carved, as a share.
const CONCAVE_SHARE: f64 = 0.06;
/// A symmetry explains an object only if its hull has less than this share of free space more than the hull of what is
/// seen.
const MORE_FREE_SHARE: f64 = 0.15;
/// Most corners of a hull, and how far a point may lie outside of it, in meters.
const CORNERS: usize = 96;
const CORNER_M: f64 = 0.0005;
/// Cells along the longest side at which free space is counted, and of what is carved.
const SHARE_CELLS: f64 = 24.0;
const CELLS: f64 = 48.0;
/// Finest cell, in meters.
const FINEST_CELL_M: f64 = 0.0025;
/// Space is free only if it is this far in front of a surface or beside an outline, in meters.
const FREE_M: f64 = 0.003;

/// How the unseen side of an object is estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Completion {
    /// The hull of what is seen and of its footprint on the table, with nothing carved out.
    Hull,
    /// The same, less the space that a camera saw to be free.
    Carved,
    /// The hull of what is seen and of its image by the best symmetry about a vertical axis or plane, less free space and
    /// its image; `carved` without a symmetry.
    #[default]
    Symmetry,
    /// The superquadric on the table that is nearest to what is seen: of a box, a cylinder or an ellipsoid with rounded
    /// edges; `hull` where none can be fitted.
    Superquadric,
}

/// A closed shape.
#[derive(Debug, Clone)]
pub struct CompletedShape {
    /// The observation, its frame's origin below the middle of the shape.
    pub observation: Observation,
    /// The surface, closed, in the object's frame.
    pub mesh: TriMesh,
    /// Whether a symmetry completed it.
    pub is_symmetric: bool,
    /// Share of the hull's cells that a camera saw to be free.
    pub free_share: f64,
}

/// Completes the shape of an observed object.
///
/// # Errors
///
/// Fails if what is seen spans no volume.
pub fn complete(
    observation: &Observation,
    completion: Completion,
) -> Result<CompletedShape, CompletionError> {
    let seen = observation.points.iter();
    let on_table: Vec<Point3<f64>> = seen.clone().map(on_table).collect();
    let seen: Vec<Point3<f64>> = seen.copied().chain(on_table).collect();
    let own_free_m = |point: &Point3<f64>| observation.free_m(point);
    let plain = Hull::of(seen.clone(), own_free_m)?;
    let mut found = None;
    let (mesh, free_share) = match completion {
        Completion::Hull => (plain.mesh, plain.free_share),
        Completion::Carved => (plain.carved(own_free_m), plain.free_share),
        Completion::Superquadric => {
            let fitted = Superquadric::fitted(observation);
            let mesh = fitted.map(|fitted| fitted.mesh());
            (mesh.unwrap_or(plain.mesh), plain.free_share)
        }
        Completion::Symmetry => {
            let hull = symmetries(observation).into_iter().find_map(|symmetry| {
                let images = observation.points.iter().map(|point| symmetry.image(point));
                let free_m = move |point: &Point3<f64>| {
                    own_free_m(point).max(observation.free_m(&symmetry.image(point)))
                };
                let hull = Hull::of(seen.iter().copied().chain(images).collect(), free_m).ok()?;
                // Images in free space widen the hull, and are carved again: they explain nothing.
                (hull.free_share < plain.free_share + MORE_FREE_SHARE)
                    .then(|| (hull.carved(free_m), hull.free_share, symmetry))
            });
            match hull {
                Some((mesh, free_share, symmetry)) => {
                    found = Some(symmetry);
                    (mesh, free_share)
                }
                None => (plain.carved(own_free_m), plain.free_share),
            }
        }
    };
    let (low, high) = mesh.bounds();
    let middle = nalgebra::center(&low, &high);
    let offset = Vector3::new(middle.x, middle.y, 0.0);
    let mut observation = observation.clone();
    observation.moved(&offset);
    let vertices = mesh.vertices_m.iter();
    Ok(CompletedShape {
        observation,
        mesh: TriMesh {
            vertices_m: vertices.map(|vertex| vertex - offset).collect(),
            triangles: mesh.triangles,
        },
        is_symmetric: found.is_some(),
        free_share,
    })
}

/// A hull, and the space in it that is free.
struct Hull {
    mesh: TriMesh,
    /// The planes of its faces: unit normals, and offsets along them in meters.
    planes: Vec<(Vector3<f64>, f64)>,
    /// Share of its cells that are free.
    free_share: f64,
}

impl Hull {
    /// Takes the hull of points; `free_m` is how deep a point is in free space.
    fn of(
        points: Vec<Point3<f64>>,
        free_m: impl Fn(&Point3<f64>) -> f64,
    ) -> Result<Self, CompletionError> {
        let cloud = TriMesh {
            vertices_m: points,
            triangles: Vec::new(),
        };
        let mesh = cloud.few_hull(CORNERS, CORNER_M)?;
        let plane = |&triangle: &[u32; 3]| {
            let [a, b, c] = mesh.corners(triangle);
            let normal = (b - a).cross(&(c - a)).try_normalize(1e-15)?;
            Some((normal, normal.dot(&a.coords)))
        };
        let planes = mesh.triangles.iter().filter_map(plane).collect();
        let mut hull = Self {
            mesh,
            planes,
            free_share: 0.0,
        };
        let (low, high) = hull.mesh.bounds();
        let (mut inside_n, mut free_n) = (0.0, 0.0);
        for point in grid(low, high, (high - low).max() / SHARE_CELLS) {
            if hull.outside_m(&point) < 0.0 {
                inside_n += 1.0;
                free_n += f64::from(u8::from(free_m(&point) > FREE_M));
            }
        }
        hull.free_share = if inside_n > 0.0 {
            free_n / inside_n
        } else {
            0.0
        };
        Ok(hull)
    }

    fn outside_m(&self, point: &Point3<f64>) -> f64 {
        let planes = self.planes.iter();
        let distances = planes.map(|(normal, offset)| normal.dot(&point.coords) - offset);
        distances.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Carves free space out of it, if there is much.
    fn carved(&self, free_m: impl Fn(&Point3<f64>) -> f64) -> TriMesh {
        if self.free_share < CONCAVE_SHARE {
            return self.mesh.clone();
        }
        let (low, high) = self.mesh.bounds();
        let cell_m = ((high - low).max() / CELLS).max(FINEST_CELL_M);
        let room = Vector3::repeat(2.5 * cell_m);
        let distance_m = |point: &Point3<f64>| {
            let free_m = free_m(point) - FREE_M;
            // Far in free space the hull does not matter.
            if free_m > 2.0 * cell_m {
                free_m
            } else {
                free_m.max(self.outside_m(point))
            }
        };
        // Below the table is outside of the hull.
        let mesh = sampled_level_set(distance_m, low - room, high + room, cell_m);
        largest_body(&mesh).unwrap_or_else(|| self.mesh.clone())
    }
}

/// Returns the vertex that stands for the body of another one, and shortens the way to it.
fn root(body_of: &mut [usize], mut idx: usize) -> usize {
    while body_of[idx] != idx {
        body_of[idx] = body_of[body_of[idx]];
        idx = body_of[idx];
    }
    idx
}

/// Returns the body of the largest volume of a closed mesh; `None` without a triangle.
fn largest_body(mesh: &TriMesh) -> Option<TriMesh> {
    let mut body_of: Vec<usize> = (0..mesh.vertices_m.len()).collect();
    for &triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|idx| root(&mut body_of, idx as usize));
        let least = a.min(b).min(c);
        for idx in [a, b, c] {
            body_of[idx] = least;
        }
    }
    let mut bodies: BTreeMap<usize, Vec<[u32; 3]>> = BTreeMap::new();
    for &triangle in &mesh.triangles {
        let body = root(&mut body_of, triangle[0] as usize);
        bodies.entry(body).or_default().push(triangle);
    }
    let of_triangles = |triangles: Vec<[u32; 3]>| TriMesh {
        vertices_m: mesh.vertices_m.clone(),
        triangles,
    };
    let bodies = bodies.into_values().map(of_triangles);
    let largest = bodies.max_by(|a, b| a.volume_m3().total_cmp(&b.volume_m3()))?;
    Some(largest.without_unused())
}

/// Returns the point of the table below one.
fn on_table(point: &Point3<f64>) -> Point3<f64> {
    Point3::new(point.x, point.y, 0.0)
}

/// Returns points at equal distances in a box.
fn grid(low: Point3<f64>, high: Point3<f64>, step_m: f64) -> impl Iterator<Item = Point3<f64>> {
    let along = move |axis: usize| {
        let n = ((high[axis] - low[axis]) / step_m).ceil();
        (0..1000_u32)
            .map(f64::from)
            .take_while(move |&k| k < n)
            .map(move |k| low[axis] + (k + 0.5) * step_m)
    };
    along(0)
        .flat_map(move |x| along(1).flat_map(move |y| along(2).map(move |z| Point3::new(x, y, z))))
}

#[cfg(test)]
mod tests {
    use depth_view::{DepthView, Intrinsics, RenderedObject, StereoNoise, looking_at, render};
    use geometry::solid::{ellipse, loft, rounded_rectangle};
    use nalgebra::UnitQuaternion;
    use spatial::Pose;

    use super::*;

    /// Observes a body, turned by `yaw_rad`, with the errors of a stereo camera.
    fn observed(mesh: &TriMesh, yaw_rad: f64) -> Observation {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let object = RenderedObject {
            mesh,
            world_from_object: Pose::from_parts([0.02, -0.01, 0.0], turn),
        };
        let camera = looking_at(Point3::new(0.45, 0.1, 0.42), Point3::new(0.0, 0.0, 0.05));
        let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera);
        let view = StereoNoise::default().measured(&rendered, 1);
        Observation::new(&[view], None).unwrap()
    }

    #[test]
    fn standing_bodies_are_closed_to_their_volume() {
        let carton = loft(&[0.0, 0.14].map(|z| rounded_rectangle(0.03, 0.045, 0.004, z)));
        let can = loft(&[0.0, 0.11].map(|z| ellipse(0.035, 0.035, 2.0, z, 48)));
        for (body, yaw_rad) in [(&carton, 0.2), (&carton, 0.9), (&can, 0.0)] {
            let observation = observed(body, yaw_rad);
            for completion in [
                Completion::Hull,
                Completion::Carved,
                Completion::Symmetry,
                Completion::Superquadric,
            ] {
                let shape = complete(&observation, completion).unwrap();
                assert!(shape.mesh.is_watertight());
                let ratio = shape.mesh.volume_m3() / body.volume_m3();
                assert!((0.85..1.2).contains(&ratio), "{completion:?}: {ratio}");
                let at = shape.observation.world_from_object.translation.vector;
                assert!((at - Vector3::new(0.02, -0.01, 0.0)).norm() < 0.008, "{at}");
            }
        }
    }

    #[test]
    fn the_back_of_a_lying_can_is_its_front_mirrored() {
        let can = loft(&[-0.05, 0.05].map(|z| ellipse(0.035, 0.035, 2.0, z, 48)));
        let lying =
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let vertices = can.vertices_m.iter();
        let can = TriMesh {
            vertices_m: vertices
                .map(|v| lying * v + Vector3::new(0.0, 0.0, 0.035))
                .collect(),
            triangles: can.triangles,
        };
        // The camera looks at its long side.
        let observation = observed(&can, 0.22);
        let depth_m = |completion: Completion| {
            let (low, high) = complete(&observation, completion).unwrap().mesh.bounds();
            high.x - low.x
        };
        // It is 7 cm across; from 43 degrees above, the farthest 1.1 cm are behind its top.
        assert!(depth_m(Completion::Carved) < 0.063);
        assert!((depth_m(Completion::Symmetry) - 0.07).abs() < 0.012);
        assert!((depth_m(Completion::Superquadric) - 0.07).abs() < 0.012);
    }

    #[test]
    fn what_is_seen_to_be_free_is_not_filled() {
        // A cup, open to the top.
        let outer = loft(&[0.0, 0.09].map(|z| ellipse(0.045, 0.045, 2.0, z, 48)));
        let inner = loft(&[0.004, 0.09].map(|z| ellipse(0.041, 0.041, 2.0, z, 48)));
        let n = u32::try_from(outer.vertices_m.len()).unwrap();
        let inward = inner
            .triangles
            .iter()
            .map(|&[a, b, c]| [a + n, c + n, b + n]);
        let cup = TriMesh {
            vertices_m: [outer.vertices_m, inner.vertices_m].concat(),
            triangles: outer.triangles.iter().copied().chain(inward).collect(),
        };
        // Without the two lids.
        let is_lid =
            |triangle: &[u32; 3]| cup.corners(*triangle).iter().all(|corner| corner.z > 0.089);
        let open = TriMesh {
            triangles: cup
                .triangles
                .iter()
                .copied()
                .filter(|t| !is_lid(t))
                .collect(),
            ..cup.clone()
        };
        let observation = observed(&open, 0.0);
        let volume =
            |completion: Completion| complete(&observation, completion).unwrap().mesh.volume_m3();
        let hull = volume(Completion::Hull);
        let carved = volume(Completion::Carved);
        assert!(carved < 0.85 * hull, "{carved} {hull}");
        // The image of the free space by half a turn is free, too.
        let both = volume(Completion::Symmetry);
        assert!(both < 0.9 * carved, "{both} {carved}");
    }

    #[test]
    fn stray_pixels_of_a_mask_are_no_part_of_the_object() {
        let carton = loft(&[0.0, 0.14].map(|z| rounded_rectangle(0.03, 0.045, 0.004, z)));
        let object = RenderedObject {
            mesh: &carton,
            world_from_object: Pose::identity(),
        };
        let camera = looking_at(Point3::new(0.45, 0.1, 0.42), Point3::new(0.0, 0.0, 0.05));
        let view = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera).view;
        let mut stray = view.clone();
        // A patch of the table behind it, apart from the outline.
        let top = view.mask.iter().position(|&own| own).unwrap();
        let (x, y) = view.intrinsics.coordinates(top);
        for row in y - 60..y - 45 {
            stray.mask[row * 640 + x..row * 640 + x + 15].fill(true);
        }
        let volume = |view: &DepthView| {
            let observation = Observation::new(std::slice::from_ref(view), None).unwrap();
            let shape = complete(&observation, Completion::Symmetry).unwrap();
            shape.mesh.volume_m3()
        };
        assert!((volume(&stray) / volume(&view) - 1.0).abs() < 0.02);
    }

    #[test]
    fn nothing_seen_is_an_error() {
        assert!(matches!(
            Observation::new(&[], None),
            Err(CompletionError::NoView)
        ));
    }
}
