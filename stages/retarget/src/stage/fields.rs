//! One object's distances.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::Write,
};

use dataflow::{Artifact, Context, Inputs, Made, Outcome};
use geometry::TriMesh;
use schemas::{distance_fields, objects};

use super::{missing, schema, skipped};
use crate::{RetargetConfig, RetargetError, scene::survey};

/// Makes the distance field of one object.
pub(super) fn make(
    config: &RetargetConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, RetargetError> {
    let object = inputs
        .artifacts("objects")
        .first()
        .ok_or_else(|| missing(cx, "object"))?;
    let mesh = match read_mesh(object, cx)? {
        Ok(mesh) => mesh,
        Err(reason) => return Ok(skipped(reason)),
    };
    let (field, info) = match survey(&mesh, config.field_spacing_m) {
        Ok(Some(surveyed)) => surveyed,
        Ok(None) => return Ok(skipped("its mesh has no surface")),
        Err(err) => return Ok(skipped(format!("its mesh: {err}"))),
    };
    let batch = distance_fields::to_batch(&info).map_err(schema(cx))?;
    lake::table::write(cx.folder(), &batch)?;
    let path = cx.folder().join(distance_fields::FIELD);
    let written = File::create_new(&path).and_then(|mut file| file.write_all(&field.to_bytes()));
    written.map_err(|source| RetargetError::WriteField {
        object: object.key.clone(),
        source,
    })?;
    Ok(Outcome::Made(Made {
        labels: BTreeMap::from([("object".to_owned(), object.key.clone())]),
        metrics: BTreeMap::from([("hull_vertices_n".to_owned(), info.hull_m.len() as f64)]),
    }))
}

/// Reads an object's mesh; the inner error is the reason to skip it.
pub(super) fn read_mesh(
    object: &Artifact,
    cx: &Context,
) -> Result<Result<TriMesh, String>, RetargetError> {
    let path = object
        .file(objects::MESH)
        .ok_or_else(|| missing(cx, "mesh of an object"))?;
    let text = fs::read_to_string(path).map_err(|source| RetargetError::ReadMesh {
        object: object.key.clone(),
        source,
    })?;
    Ok(TriMesh::from_obj(&text)
        .map_err(|err| format!("the mesh of its object `{}`: {err}", object.key)))
}
