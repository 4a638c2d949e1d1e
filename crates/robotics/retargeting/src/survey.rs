//! Distance field and hull of an object, computed once.

use geometry::{DistanceField, GeometryError, TriMesh, mass_properties};
use nalgebra::Point3;

/// Room around an object's bounds for which distances are computed, in meters: more than the radius
/// of any sphere of a hand with its clearance, or a person's touch, asks for.
const MARGIN_M: f64 = 0.025;

/// An object's shape, in its own frame.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Signed distances from its surface, in meters.
    pub field: DistanceField,
    /// Room around the object's bounds that the field covers, in meters.
    pub margin_m: f64,
    /// Center of mass of a solid of this shape, in meters.
    pub center_of_mass_in_object: Point3<f64>,
    /// Vertices of its convex hull, in meters; all vertices of a flat mesh, which has none.
    pub hull_in_object: Vec<Point3<f64>>,
}

/// Computes the distances about an object, and its hull; `None` if its mesh has no surface.
///
/// `mesh` is in meters, in the object's frame, and `spacing_m` the distance between neighboring nodes of the field.
///
/// # Errors
///
/// Fails if the mesh is far too large for the spacing.
pub fn survey(mesh: &TriMesh, spacing_m: f64) -> Result<Option<Survey>, GeometryError> {
    let Some(field) = DistanceField::new(mesh, spacing_m, MARGIN_M)? else {
        return Ok(None);
    };
    let hull = mesh.convex_hull();
    let hull = hull.as_ref().unwrap_or(mesh);
    Ok(Some(Survey {
        field,
        margin_m: MARGIN_M,
        // Where the center lies does not depend on the mass.
        center_of_mass_in_object: mass_properties(mesh, 1.0).center_of_mass_m,
        hull_in_object: hull.vertices_m.clone(),
    }))
}
