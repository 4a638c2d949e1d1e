//! One object's distances.

use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Sum};
use geometry::TriMesh;
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact};
use retargeting::survey;
use schemas::{
    Table,
    distance_fields::{self, FieldInfo},
    objects::{self, Object},
};

use crate::RetargetConfig;

dataflow::metrics! {
    /// Metrics of an object's distances.
    pub struct FieldMetrics {
        /// Number of the vertices of its convex hull.
        hull_vertices_n: Sum,
    }
}

/// Makes the distance field of one object.
pub(super) fn make(
    config: &RetargetConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<FieldMetrics>, BoxedDiagnostic> {
    let object = inputs.artifact(Object::NAME)?;
    let mesh = match read_mesh(object)? {
        Ok(mesh) => mesh,
        Err(reason) => return Ok(Outcome::skipped(reason)),
    };
    let surveyed = match survey(&mesh, config.field_spacing_m) {
        Ok(Some(surveyed)) => surveyed,
        Ok(None) => return Ok(Outcome::skipped("its mesh has no surface")),
        Err(err) => return Ok(Outcome::skipped(format!("its mesh: {err}"))),
    };
    let hull = surveyed.hull_in_object.iter();
    let info = FieldInfo {
        spacing_m: config.field_spacing_m,
        margin_m: surveyed.margin_m,
        center_of_mass_m: surveyed.center_of_mass_in_object.into(),
        hull_m: hull.map(|&vertex| vertex.into()).collect(),
    };
    cx.write(&info)?;
    cx.write_file(distance_fields::FIELD, &surveyed.field.to_bytes())?;
    let metrics = FieldMetrics {
        hull_vertices_n: info.hull_m.len() as f64,
    };
    Ok(Outcome::Made(metrics))
}

/// Reads an object's mesh; the inner error is the reason to skip it.
pub(super) fn read_mesh(object: &Artifact) -> Result<Result<TriMesh, String>, LakeError> {
    Ok(TriMesh::from_obj(&object.text(objects::MESH)?)
        .map_err(|err| format!("the mesh of its object `{}`: {err}", object.key)))
}
