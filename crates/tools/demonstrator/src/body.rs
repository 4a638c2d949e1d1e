//! One object prepared for grasping.

use std::f64::consts::TAU;

use geometry::{NearestPoint, SurfaceDistance, TriMesh, mass_properties, stable_rests};
use nalgebra::{Point3, Unit, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spatial::RestingPose;

use crate::objects::{GraspPlacement, ObjectKind};

/// An object with what is computed from its mesh once.
pub(crate) struct Body {
    pub(crate) kind: &'static ObjectKind,
    pub(crate) mesh: TriMesh,
    pub(crate) surface: SurfaceDistance,
    /// Center of mass, object frame, in meters.
    pub(crate) center: Point3<f64>,
    /// Radius about the origin that holds all of it, in meters.
    pub(crate) radius_m: f64,
    upright: RestingPose,
    /// Other stable ways to lie, with their probabilities.
    lying: Vec<(RestingPose, f64)>,
}

/// Rests within this cosine of the frame's z axis are not another way to lie.
const UPRIGHT_COSINE: f64 = 0.9;
/// Tilt that an object that lies firmly comes back from, in radians, and the least lift of its
/// center of mass by that tilt, in meters: boxes lie firmly, cans roll.
const TILT_RAD: f64 = 0.14;
const TILT_LIFT_M: f64 = 0.0008;

/// Says whether an object on the table comes back from being tilted to any side.
fn lies_firmly(mesh: &TriMesh, center: &Point3<f64>, rest: &RestingPose) -> bool {
    let lift = |up: &Vector3<f64>| {
        let lowest = mesh
            .vertices_m
            .iter()
            .map(|v| up.dot(&v.coords))
            .fold(f64::MAX, f64::min);
        up.dot(&center.coords) - lowest
    };
    let flat = lift(&rest.up_in_object);
    (0..16).all(|k| {
        let aside = horizontal(rest, TAU * f64::from(k) / 16.0);
        let tilted =
            rest.up_in_object.into_inner() * TILT_RAD.cos() + aside.into_inner() * TILT_RAD.sin();
        lift(&tilted) - flat > TILT_LIFT_M
    })
}

impl Body {
    /// Makes the mesh and what follows from it.
    pub(crate) fn new(kind: &'static ObjectKind) -> Self {
        let mesh = (kind.mesh)();
        let center = mass_properties(&mesh, 1.0).center_of_mass_m;
        let stable = stable_rests(&mesh, &center);
        let upright = stable
            .iter()
            .map(|stable| stable.rest)
            .find(|rest| rest.up_in_object.z > UPRIGHT_COSINE)
            .unwrap_or(RestingPose {
                up_in_object: Vector3::z_axis(),
                height_m: -mesh.bounds().0.z,
            });
        let lying = stable
            .into_iter()
            .filter(|stable| stable.rest.up_in_object.z.abs() < UPRIGHT_COSINE)
            .filter(|stable| lies_firmly(&mesh, &center, &stable.rest))
            .map(|stable| (stable.rest, stable.probability))
            .collect();
        let radius_m = mesh
            .vertices_m
            .iter()
            .map(|v| v.coords.norm())
            .fold(0.0, f64::max);
        Self {
            kind,
            surface: SurfaceDistance::new(&mesh),
            mesh,
            center,
            radius_m,
            upright,
            lying,
        }
    }

    /// Draws how it lies: mostly upright.
    pub(crate) fn draw_rest(&self, rng: &mut ChaCha8Rng, lying_share: f64) -> RestingPose {
        let lies = rng.random::<f64>() < lying_share && self.kind.handling == GraspPlacement::Any;
        let all: f64 = self.lying.iter().map(|(_, share)| share).sum();
        let mut target = rng.random::<f64>() * all;
        for (rest, share) in &self.lying {
            target -= share;
            if lies && target <= 0.0 {
                return *rest;
            }
        }
        self.upright
    }

    /// Returns how it stands as in its own frame.
    pub(crate) fn upright(&self) -> RestingPose {
        self.upright
    }

    /// Returns the first surface point that a ray meets within `reach_m`.
    pub(crate) fn trace(
        &self,
        from: &Point3<f64>,
        along: &Vector3<f64>,
        reach_m: f64,
    ) -> Option<NearestPoint> {
        let mut way = 0.0;
        for _ in 0..60 {
            let nearest = self.surface.signed_distance(&(from + along * way));
            if nearest.distance_m < 2e-4 {
                return Some(nearest);
            }
            way += nearest.distance_m;
            if way > reach_m {
                return None;
            }
        }
        None
    }
}

/// Returns the height of a point in the object's frame above the table, in meters.
pub(crate) fn height_m(rest: &RestingPose, point: &Point3<f64>) -> f64 {
    rest.up_in_object.dot(&point.coords) + rest.height_m
}

/// Returns a horizontal direction in the object's frame, by an angle about the up direction.
pub(crate) fn horizontal(rest: &RestingPose, angle: f64) -> Unit<Vector3<f64>> {
    let up = rest.up_in_object;
    let aside = if up.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let first = Unit::new_normalize(up.cross(&aside));
    let second = up.cross(&first);
    Unit::new_normalize(first.into_inner() * angle.cos() + second * angle.sin())
}
