//! Distance field and hull of an object, computed once.

use geometry::{DistanceField, TriMesh, mass_properties};
use schemas::distance_fields::FieldInfo;

/// Room around an object's bounds for which distances are computed, in meters: more than the radius
/// of any sphere of a hand with its clearance, or a person's touch, asks for.
const MARGIN_M: f64 = 0.025;

/// Computes the distances about an object and its size; `None` if its mesh has
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
