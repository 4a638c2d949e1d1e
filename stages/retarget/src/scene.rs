//! The object and the table that the hand must keep out of.

use geometry::{DistanceField, TriMesh, mass_properties};
use nalgebra::{Point3, Vector3};
use schemas::distance_fields::FieldInfo;
use spatial::Rest;

use crate::settle::settled;

/// Room around an object's bounds for which distances are computed, in meters: more than the radius
/// of any ball of a hand with its clearance, or a person's touch, asks for.
const MARGIN_M: f64 = 0.025;

/// An object that lies on a table, in the object frame.
pub(crate) struct Scene {
    field: DistanceField,
    rest: Rest,
}

/// How far a point is from the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gap {
    /// Signed distance in meters, negative inside.
    pub(crate) distance_m: f64,
    /// Its gradient, about of length 1.
    pub(crate) away: Vector3<f64>,
}

/// Computes the distances about an object and what else a scene is made of; `None` if its mesh has
/// no surface.
///
/// # Errors
///
/// Fails if the mesh is far too large for the spacing.
pub(crate) fn survey(
    mesh: &TriMesh,
    spacing_m: f64,
) -> Result<Option<(DistanceField, FieldInfo)>, geometry::GeometryError> {
    let Some(field) = DistanceField::new(mesh, spacing_m, MARGIN_M)? else {
        return Ok(None);
    };
    // A flat mesh has no hull: its own vertices serve.
    let hull = mesh.convex_hull();
    let hull = hull
        .as_ref()
        .map_or(&mesh.vertices_m, |hull| &hull.vertices_m);
    let info = FieldInfo {
        spacing_m,
        margin_m: MARGIN_M,
        // Where the center lies does not depend on the mass.
        center_of_mass_m: mass_properties(mesh, 1.0).center_of_mass_m.into(),
        hull_m: hull.iter().map(|&vertex| vertex.into()).collect(),
    };
    Ok(Some((field, info)))
}

impl Scene {
    /// Puts an object down as it lay, but for errors of the recording.
    pub(crate) fn new(field: DistanceField, info: &FieldInfo, recorded: &Rest) -> Self {
        let hull: Vec<Point3<f64>> = info.hull_m.iter().map(|&v| Point3::from(v)).collect();
        let rest = settled(&hull, &Point3::from(info.center_of_mass_m), recorded);
        Self { field, rest }
    }

    /// Returns how the object lies.
    pub(crate) fn rest(&self) -> Rest {
        self.rest
    }

    /// Returns how far a point is from the object's surface.
    pub(crate) fn gap(&self, point: &Point3<f64>) -> Gap {
        let (distance_m, away) = self.field.distance(point);
        Gap { distance_m, away }
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
            assert!((gap.distance_m - distance_m).abs() < 1e-6, "{gap:?}");
            assert!((gap.away - Vector3::x()).norm() < 1e-3, "{gap:?}");
        }
    }
}
