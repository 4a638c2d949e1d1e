//! Mass properties of solids of even density.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::TriMesh;

/// Volumes between these parts of the hull's volume can be a solid's: the lower bound is half of a
/// bowl's thin wall.
const SANE_SHARE_OF_HULL: std::ops::Range<f64> = 0.02..1.02;

/// Mass properties of a rigid body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassProperties {
    /// Mass, in kilograms.
    pub mass_kg: f64,
    /// Center of mass in the mesh's frame, in meters.
    pub center_of_mass_m: Point3<f64>,
    /// Inertia about the center of mass along the mesh's axes, in kg m².
    pub inertia_kg_m2: Matrix3<f64>,
}

/// Returns the mass properties of a body of the given mass, spread evenly over the enclosed volume.
///
/// Where the mesh does not enclose a sane volume (open, or not between 2 % and 102 % of its hull's)
/// the hull's volume is taken, and for a flat mesh its bounding box.
pub fn mass_properties(mesh: &TriMesh, mass_kg: f64) -> MassProperties {
    let hull = mesh.convex_hull().ok();
    let sane = hull.as_ref().is_none_or(|hull| {
        SANE_SHARE_OF_HULL.contains(&(mesh.volume_m3().abs() / hull.volume_m3()))
    });
    if sane
        && mesh.is_watertight()
        && let Some(own) = of_solid(mesh, mass_kg)
    {
        return own;
    }
    hull.and_then(|hull| of_solid(&hull, mass_kg))
        .unwrap_or_else(|| of_box(mesh, mass_kg))
}

/// Integrates over the tetrahedra between each triangle and the middle of the bounds
/// (Tonon, "Explicit exact formulas for the 3-D tetrahedron inertia tensor", 2005).
fn of_solid(mesh: &TriMesh, mass_kg: f64) -> Option<MassProperties> {
    let middle = mesh.middle();
    let mut volume = 0.0;
    let mut first = Vector3::zeros();
    let mut second = Matrix3::zeros();
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle).map(|corner| corner - middle);
        let part = a.dot(&b.cross(&c)) / 6.0;
        let sum = a + b + c;
        volume += part;
        first += sum * (part / 4.0);
        // ∫ x xᵀ over a tetrahedron with one corner at 0.
        second +=
            (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose())
                * (part / 20.0);
    }
    let center = first / volume;
    let spread = second / volume - center * center.transpose();
    let inertia = (Matrix3::identity() * spread.trace() - spread) * mass_kg;
    let principal = inertia.symmetric_eigenvalues();
    let possible = volume.abs() > 0.0 && principal.iter().all(|&moment| moment > 0.0);
    possible.then(|| MassProperties {
        mass_kg,
        center_of_mass_m: middle + center,
        inertia_kg_m2: inertia,
    })
}

/// Returns the properties of the bounding box, at least a millimeter thick.
fn of_box(mesh: &TriMesh, mass_kg: f64) -> MassProperties {
    let (low, high) = mesh.bounds();
    let squares = (high - low).map(|side| side.max(1e-3).powi(2));
    let moments = Vector3::repeat(squares.sum()) - squares;
    MassProperties {
        mass_kg,
        center_of_mass_m: mesh.middle(),
        inertia_kg_m2: Matrix3::from_diagonal(&(moments * (mass_kg / 12.0))),
    }
}
