//! The plane in which a mesh is most nearly its own mirror image.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};
use parry3d::{query::PointQuery, shape::TriMesh as Tree};

use crate::{
    TriMesh,
    single::{double, single, singles},
};

/// Directions tried over a half sphere besides the principal axes: about 8° apart.
const DIRECTIONS: usize = 350;
/// Surface points that a direction is tried, and first refined, with.
const COARSE_POINTS: usize = 80;
/// Surface points that a plane is refined with.
const FINE_POINTS: usize = 300;
/// Surface points that the error is measured at.
const ALL_POINTS: usize = 2000;
/// Directions that are refined, and how far they are apart at least, in radians.
const STARTS: usize = 14;
const APART_RAD: f64 = 0.2;
/// Planes that are refined with more points.
const FINALISTS: usize = 4;
/// Steps of the refinement; they end earlier where nothing gets better.
const STEPS: usize = 12;
/// Distance from which on a point counts less, as a part of the mesh's size: a handle that has no
/// counterpart should not turn the plane of the rest.
const OUTLIER: f64 = 0.01;
/// Planes whose errors differ by less count as equally good, in meters: scans are no better.
const EQUAL_M: f64 = 2e-4;

/// A plane in which a mesh is nearly its own mirror image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MirrorPlane {
    /// The plane's normal, in the mesh's frame; its largest coordinate is positive.
    pub normal: Unit<Vector3<f64>>,
    /// Offset of the plane, in meters: its points x have `normal` · x = `offset_m`.
    pub offset_m: f64,
    /// Distance to the surface, in meters, that 99 % of the surface stay within when reflected.
    ///
    /// The largest distance would tell of a single bump of the scan. A mean, or 95 %, would hide
    /// what decides how an object is grasped: the handle of a mug has less than a tenth of its
    /// surface, and half of that is near to the mug.
    pub error_m: f64,
}

impl MirrorPlane {
    /// Returns a point's mirror image, in meters.
    pub fn reflect_point(&self, point: &Point3<f64>) -> Point3<f64> {
        let above = self.normal.dot(&point.coords) - self.offset_m;
        point - self.normal.into_inner() * (2.0 * above)
    }

    /// Returns a direction's mirror image, as long as the direction.
    ///
    /// This is right for directions and velocities, not for angular velocities and torques, whose
    /// mirror image is the negative of this.
    pub fn reflect_direction(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        direction - self.normal.into_inner() * (2.0 * self.normal.dot(direction))
    }
}

/// Returns the plane in which the mesh is most nearly its own mirror image; `None` if the mesh has
/// no area.
///
/// Every shape has a best plane: whether it is good enough, [`MirrorPlane::error_m`] tells.
/// Among planes that are equally good within 0.2 mm, as a box has three and a can infinitely many,
/// one across a principal axis of the surface is taken, the axis of the largest spread first.
/// Equal meshes and seeds give equal planes; the seed decides which points of the surface are
/// looked at.
///
/// The plane of a symmetric surface contains its centroid, so that only directions are searched;
/// the best of them are refined, together with the place, by Gauss–Newton steps on the distances of
/// reflected points from the surface with Cauchy's weights.
///
/// # Panics
///
/// Panics if a triangle names a vertex that the mesh does not have.
pub fn mirror_plane(mesh: &TriMesh, seed: u64) -> Option<MirrorPlane> {
    let (points, _) = mesh.sample_surface(ALL_POINTS, seed);
    let (coarse, fine) = (points.get(..COARSE_POINTS)?, points.get(..FINE_POINTS)?);
    let (centroid, axes) = principal_axes(mesh)?;
    let surface = Surface::new(mesh)?;
    let through_centroid = |normal: Vector3<f64>| Plane {
        normal,
        offset_m: normal.dot(&centroid.coords),
    };

    let mut starts: Vec<Plane> = axes
        .column_iter()
        .map(|axis| through_centroid(axis.into()))
        .collect();
    let mut tried: Vec<(f64, Plane)> = half_sphere(DIRECTIONS)
        .map(|direction| through_centroid(axes * direction))
        .map(|plane| (surface.cost(&plane, coarse), plane))
        .collect();
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, plane) in tried {
        let is_apart = |known: &Plane| plane.normal.dot(&known.normal).abs() < APART_RAD.cos();
        if starts.len() < STARTS && starts.iter().all(is_apart) {
            starts.push(plane);
        }
    }

    let mut planes: Vec<(Plane, MirrorPlane)> = starts
        .into_iter()
        .map(|start| surface.refine(start, coarse))
        .map(|plane| (plane, surface.measure(&plane, fine)))
        .collect();
    // The order is kept, so that the principal axes stay first.
    keep_within(&mut planes, |least_m| 1.5 * least_m + EQUAL_M);
    planes.truncate(FINALISTS);
    for (plane, measured) in &mut planes {
        *measured = surface.measure(&surface.refine(*plane, fine), &points);
    }
    keep_within(&mut planes, |least_m| least_m + EQUAL_M);
    planes.first().map(|(_, measured)| *measured)
}

/// Keeps the planes whose error is within a limit that depends on the least error.
fn keep_within(planes: &mut Vec<(Plane, MirrorPlane)>, limit_m: impl Fn(f64) -> f64) {
    let errors = planes.iter().map(|(_, measured)| measured.error_m);
    let limit_m = limit_m(errors.fold(f64::INFINITY, f64::min));
    planes.retain(|(_, measured)| measured.error_m <= limit_m);
}

/// A plane under search: its points x have `normal` · x = `offset_m`.
#[derive(Clone, Copy)]
struct Plane {
    normal: Vector3<f64>,
    offset_m: f64,
}

impl Plane {
    fn above_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    fn reflect(&self, point: &Point3<f64>) -> Point3<f64> {
        point - self.normal * (2.0 * self.above_m(point))
    }
}

/// A mesh prepared for unsigned distances.
struct Surface {
    tree: Tree,
    /// Distance from which on a point counts less, in meters.
    scale_m: f64,
}

impl Surface {
    fn new(mesh: &TriMesh) -> Option<Self> {
        let solid = |triangle: &&[u32; 3]| mesh.area_normal(**triangle).norm() > 0.0;
        let triangles = mesh.triangles.iter().filter(solid).copied().collect();
        let (low, high) = mesh.bounds();
        Some(Self {
            tree: Tree::new(singles(&mesh.vertices_m), triangles).ok()?,
            scale_m: OUTLIER * (high - low).norm(),
        })
    }

    /// Returns the vector from the surface to a point, in meters.
    fn offset(&self, point: &Point3<f64>) -> Vector3<f64> {
        let nearest = self.tree.project_local_point(single(point), false);
        point - double(&nearest.point)
    }

    /// Returns the sum of Cauchy's ρ over the points.
    fn cost(&self, plane: &Plane, points: &[Point3<f64>]) -> f64 {
        points
            .iter()
            .map(|point| self.offset(&plane.reflect(point)).norm() / self.scale_m)
            .map(|distance| distance.powi(2).ln_1p())
            .sum()
    }

    /// Returns the plane after steps that each lower the cost.
    ///
    /// With `u` and `v` along the plane, the mirror image p − 2 (n·p − d) n moves by
    /// −2 ((a u + b v)·p − δd) n − 2 (n·p − d) (a u + b v) where n turns by a u + b v and d grows by
    /// δd; its distance changes by the part of that along the way from the surface.
    fn refine(&self, start: Plane, points: &[Point3<f64>]) -> Plane {
        let (mut best, mut cost) = (start, self.cost(&start, points));
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let u = best.normal.cross(&away_from(&best.normal)).normalize();
            let v = best.normal.cross(&u);
            let mut hessian = Matrix3::zeros();
            let mut gradient = Vector3::zeros();
            for point in points {
                let offset = self.offset(&best.reflect(point));
                let distance = offset.norm();
                // Rounding in f32 has no direction.
                let Some(way) = offset.try_normalize(1e-7) else {
                    continue;
                };
                let (along, above) = (best.normal.dot(&way), best.above_m(point));
                let turn =
                    |t: &Vector3<f64>| -2.0 * (t.dot(&point.coords) * along + above * t.dot(&way));
                let jacobian = Vector3::new(turn(&u), turn(&v), 2.0 * along);
                let weight = 1.0 / (1.0 + (distance / self.scale_m).powi(2));
                hessian += jacobian * jacobian.transpose() * weight;
                gradient += jacobian * (weight * distance);
            }
            let damped = hessian + Matrix3::from_diagonal(&hessian.diagonal()) * damping;
            let Some(step) = damped.cholesky().map(|factor| -factor.solve(&gradient)) else {
                break;
            };
            let next = Plane {
                normal: (best.normal + u * step.x + v * step.y).normalize(),
                offset_m: best.offset_m + step.z,
            };
            let next_cost = self.cost(&next, points);
            if next_cost < cost {
                let settled = next_cost > cost * (1.0 - 1e-4);
                (best, cost, damping) = (next, next_cost, damping * 0.1);
                if settled {
                    break;
                }
            } else {
                damping *= 30.0;
            }
        }
        best
    }

    fn measure(&self, plane: &Plane, points: &[Point3<f64>]) -> MirrorPlane {
        let mut distances: Vec<f64> = points
            .iter()
            .map(|point| self.offset(&plane.reflect(point)).norm())
            .collect();
        distances.sort_by(f64::total_cmp);
        let sign = plane.normal[plane.normal.iamax()].signum();
        MirrorPlane {
            normal: Unit::new_normalize(plane.normal * sign),
            offset_m: plane.offset_m * sign,
            error_m: distances[distances.len() * 99 / 100],
        }
    }
}

/// Returns the centroid of a surface, in meters, and its principal axes as columns, the one of the
/// largest spread first; `None` if it has no area.
fn principal_axes(mesh: &TriMesh) -> Option<(Point3<f64>, Matrix3<f64>)> {
    let middle = mesh.middle();
    let mut area = 0.0;
    let mut first = Vector3::zeros();
    let mut second = Matrix3::zeros();
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle).map(|corner| corner - middle);
        let (part, sum) = (mesh.area_normal(triangle).norm(), a + b + c);
        area += part;
        first += sum * (part / 3.0);
        // ∫ x xᵀ over a triangle.
        second +=
            (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose())
                * (part / 12.0);
    }
    if area <= 0.0 || area.is_nan() {
        return None;
    }
    let center = first / area;
    let eigen = SymmetricEigen::new(second / area - center * center.transpose());
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let axes = order.map(|k| eigen.eigenvectors.column(k).into_owned());
    Some((middle + center, Matrix3::from_columns(&axes)))
}

/// Returns directions evenly over the half sphere around z: a spiral whose turns advance by the
/// golden angle.
fn half_sphere(n: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..n).map(move |k| {
        let z = (k as f64 + 0.5) / n as f64;
        let radius = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden * k as f64).sin_cos();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

/// Returns the coordinate axis farthest from a direction.
fn away_from(direction: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    axis
}
