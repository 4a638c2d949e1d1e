//! What the hand must not run into: the object and the table it lies on.

use std::f64::consts::PI;

use geometry::{SurfaceDistance, TriMesh, mass_properties};
use nalgebra::{Point3, Vector3};
use spatial::Rest;

use crate::settle::settled;

/// Below this distance the direction to the surface is taken from the surface itself, in meters.
const ON_SURFACE_M: f64 = 1e-7;

/// An object as it lies on a table, in the object frame.
pub(crate) struct Scene {
    mesh: TriMesh,
    distance: SurfaceDistance,
    rest: Rest,
}

/// How far a point is from the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gap {
    /// Signed distance in meters, negative inside.
    pub(crate) distance_m: f64,
    /// Its gradient, a unit vector.
    pub(crate) away: Vector3<f64>,
}

impl Scene {
    /// Prepares an object that lies as it lay, but for errors of the recording; `None` if its mesh
    /// has no surface.
    pub(crate) fn new(mesh: TriMesh, recorded: &Rest) -> Option<Self> {
        let distance = SurfaceDistance::new(&mesh);
        let is_solid = distance
            .signed_distance(&Point3::origin())
            .distance_m
            .is_finite();
        // Where the center lies does not depend on the mass.
        let center_of_mass = mass_properties(&mesh, 1.0).center_of_mass_m;
        let rest = settled(&mesh.vertices_m, &center_of_mass, recorded);
        is_solid.then_some(Self {
            mesh,
            distance,
            rest,
        })
    }

    /// Returns the object's surface, in the object frame.
    pub(crate) fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// Returns how the object lies.
    pub(crate) fn rest(&self) -> Rest {
        self.rest
    }

    /// Returns how far a point is from the object's surface.
    pub(crate) fn gap(&self, point: &Point3<f64>) -> Gap {
        let nearest = self.distance.signed_distance(point);
        let mut distance_m = nearest.distance_m;
        if distance_m.abs() < ON_SURFACE_M {
            return Gap {
                distance_m,
                away: nearest.normal,
            };
        }
        // The nearest triangle of a thin wall may cut through the other side of it, and then takes
        // points far outside for points inside: ask the whole mesh.
        if distance_m < 0.0 && winding_number(&self.mesh, point) < 0.5 {
            distance_m = -distance_m;
        }
        Gap {
            distance_m,
            away: (point - nearest.point) / distance_m,
        }
    }

    /// Returns a point's height above the table, in meters.
    pub(crate) fn height_m(&self, point: &Point3<f64>) -> f64 {
        self.rest.up_in_object.dot(&point.coords) + self.rest.height_m
    }

    /// Returns the unit vector against gravity.
    pub(crate) fn up(&self) -> Vector3<f64> {
        self.rest.up_in_object.into_inner()
    }
}

/// Returns how often a closed mesh winds around a point: 1 inside, 0 outside, whatever cuts through
/// itself (Jacobson et al., "Robust inside-outside segmentation using generalized winding numbers",
/// 2013, with the solid angle of van Oosterom and Strackee, 1983).
fn winding_number(mesh: &TriMesh, point: &Point3<f64>) -> f64 {
    let solid_angle: f64 = mesh
        .triangles
        .iter()
        .map(|&triangle| {
            let [a, b, c] = mesh.corners(triangle).map(|corner| corner - point);
            let (length_a, length_b, length_c) = (a.norm(), b.norm(), c.norm());
            let volume = a.dot(&b.cross(&c));
            let rest = length_a * length_b * length_c
                + a.dot(&b) * length_c
                + b.dot(&c) * length_a
                + c.dot(&a) * length_b;
            2.0 * volume.atan2(rest)
        })
        .sum();
    solid_angle / (4.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn gaps_of_a_box_are_signed() {
        let scene = fixture::scene();
        let [x, _, _] = fixture::BOX_HALF_M;
        for (at, distance_m) in [(x + 0.02, 0.02), (x - 0.01, -0.01)] {
            let gap = scene.gap(&Point3::new(at, 0.0, 0.0));
            assert!((gap.distance_m - distance_m).abs() < 1e-9, "{gap:?}");
            assert!((gap.away - Vector3::x()).norm() < 1e-9, "{gap:?}");
        }
        assert!((winding_number(&scene.mesh, &Point3::new(0.01, 0.0, 0.0)) - 1.0).abs() < 1e-9);
        assert!(winding_number(&scene.mesh, &Point3::new(0.1, 0.0, 0.0)).abs() < 1e-9);
    }

    #[test]
    fn a_wall_that_cuts_through_itself_has_one_inside() {
        // A thin plate whose front is dented through its back: where the dent comes out, the
        // nearest triangle faces away from those who look at it.
        let mut mesh = fixture::mesh();
        for vertex in &mut mesh.vertices_m {
            vertex.x = vertex.x.signum() * 5e-4;
        }
        let (front, dent) = (
            mesh.triangles[10],
            u32::try_from(mesh.vertices_m.len()).unwrap(),
        );
        mesh.vertices_m.push(Point3::new(-0.01, 0.0, 0.0));
        mesh.triangles.remove(10);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            mesh.triangles.push([front[from], front[to], dent]);
        }
        let scene = Scene::new(mesh, &fixture::rest()).unwrap();
        let behind = Point3::new(-0.03, 0.0, 0.0);
        assert!(scene.distance.signed_distance(&behind).distance_m < 0.0);
        assert!(scene.gap(&behind).distance_m > 0.0);
    }
}
