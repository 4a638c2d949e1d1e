//! An object whose shape is known.

use geometry::{DistanceField, SurfaceDistance, TriMesh};
use nalgebra::{Point3, Vector3};
use spatial::{Object, Pose, RestingPose};

use crate::RegistrationError;

/// Points on the surface.
const POINTS: usize = 1200;
/// Points at which surfaces in two poses are compared exactly.
const COMPARED: usize = 500;
/// Seed of the points: they are part of the method, equal meshes have equal ones.
const SEED: u64 = 0;
/// Distances from the surface are stored at nodes that are this share of the object's longest side apart, within these
/// bounds in meters.
const SPACING: f64 = 0.02;
const SPACINGS_M: [f64; 2] = [0.002, 0.004];
/// How far around the mesh they are stored, in meters: beyond, they are never less than the true ones.
const MARGIN_M: f64 = 0.012;

/// An object whose shape is known, prepared to be found.
#[derive(Debug, Clone)]
pub struct KnownShape {
    /// Signed distances from the surface, in the object's frame.
    pub(crate) field: DistanceField,
    /// Points on the surface, spread by area in random order.
    pub(crate) points: Vec<Point3<f64>>,
    /// Outward unit normals at the points.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// Middle of the points: what a pose turns about.
    pub(crate) middle: Point3<f64>,
    /// Root mean square distance of the points from the middle, in meters.
    pub(crate) radius_m: f64,
    /// The orientations in which it may rest.
    pub(crate) rests: Vec<RestingPose>,
}

impl KnownShape {
    /// Prepares a closed mesh that rests in one of these orientations.
    ///
    /// # Errors
    ///
    /// Fails if the mesh has no surface or is too large, or there is no orientation.
    pub fn new(mesh: &TriMesh, rests: &[RestingPose]) -> Result<Self, RegistrationError> {
        if rests.is_empty() {
            return Err(RegistrationError::NoRest);
        }
        let (low, high) = mesh.bounds();
        let spacing_m = (SPACING * (high - low).max()).clamp(SPACINGS_M[0], SPACINGS_M[1]);
        let field = DistanceField::new(mesh, spacing_m, MARGIN_M)?;
        let field = field.ok_or(RegistrationError::NoSurface)?;
        let (points, normals) = mesh.sample_surface(POINTS, SEED);
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let middle = Point3::from(sum / points.len().max(1) as f64);
        let squares = points.iter().map(|point| (point - middle).norm_squared());
        let radius_m = (squares.sum::<f64>() / points.len().max(1) as f64).sqrt();
        Ok(Self {
            field,
            points,
            normals,
            middle,
            radius_m,
            rests: rests.to_vec(),
        })
    }

    /// Returns the root mean square of the distance between the surface in one pose and that in another, in meters: a small
    /// part that moves far, as a handle, counts more in it than in the mean.
    pub(crate) fn apart_m<Frame>(
        &self,
        one: &Pose<Frame, Object>,
        other: &Pose<Frame, Object>,
    ) -> f64 {
        let distance_m = |point: &Point3<f64>| self.field.distance(point).0;
        let squares = both_ways(&self.points, one, other, distance_m).map(|off_m| off_m * off_m);
        (squares.sum::<f64>() / (2 * self.points.len().max(1)) as f64).sqrt()
    }
}

/// Returns the mean distance between a surface in one pose and the same surface in another, in meters: 0 where the object's
/// symmetry takes one to the other.
pub fn mean_surface_distance_m<Frame>(
    mesh: &TriMesh,
    one: &Pose<Frame, Object>,
    other: &Pose<Frame, Object>,
) -> f64 {
    let surface = SurfaceDistance::new(mesh);
    let (points, _) = mesh.sample_surface(COMPARED, SEED);
    let distance_m = |point: &Point3<f64>| surface.signed_distance(point).distance_m.abs();
    let sum: f64 = both_ways(&points, one, other, distance_m).sum();
    sum / (2 * points.len().max(1)) as f64
}

/// Returns the distances of points in one pose from the surface in another, and the other way round.
fn both_ways<Frame>(
    points: &[Point3<f64>],
    one: &Pose<Frame, Object>,
    other: &Pose<Frame, Object>,
    distance_m: impl Fn(&Point3<f64>) -> f64,
) -> impl Iterator<Item = f64> {
    let other_from_one: Pose<Object, Object> = other.inv_mul(one);
    let one_from_other = other_from_one.inverse();
    points.iter().flat_map(move |&point| {
        [other_from_one, one_from_other].map(|pose| distance_m(&(pose * point)))
    })
}
