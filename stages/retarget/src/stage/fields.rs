//! One object's distances.

use std::collections::BTreeMap;

use dataflow::{Artifact, Context, Inputs, Made, Outcome};
use geometry::TriMesh;
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact};
use schemas::{distance_fields, objects};

use super::skipped;
use crate::{RetargetConfig, RetargetError, scene::survey};

/// Makes the distance field of one object.
pub(super) fn make(
    config: &RetargetConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, RetargetError> {
    let object = inputs.artifact("objects")?;
    let mesh = match read_mesh(object)? {
        Ok(mesh) => mesh,
        Err(reason) => return Ok(skipped(reason)),
    };
    let (field, info) = match survey(&mesh, config.field_spacing_m) {
        Ok(Some(surveyed)) => surveyed,
        Ok(None) => return Ok(skipped("its mesh has no surface")),
        Err(err) => return Ok(skipped(format!("its mesh: {err}"))),
    };
    cx.write(&info)?;
    cx.write_file(distance_fields::FIELD, &field.to_bytes())?;
    Ok(Outcome::Made(Made {
        labels: BTreeMap::from([("object".to_owned(), object.key.clone())]),
        metrics: BTreeMap::from([("hull_vertices_n".to_owned(), info.hull_m.len() as f64)]),
    }))
}

/// Reads an object's mesh; the inner error is the reason to skip it.
pub(super) fn read_mesh(object: &Artifact) -> Result<Result<TriMesh, String>, LakeError> {
    Ok(TriMesh::from_obj(&object.text(objects::MESH)?)
        .map_err(|err| format!("the mesh of its object `{}`: {err}", object.key)))
}
