//! One object's distances.

use std::{
    fs::{self, File},
    io::Write,
};

use dataflow::{Artifact, Context, Inputs, Outcome, Sum, labels};
use geometry::TriMesh;
use schemas::{distance_fields, objects};

use super::{missing, schema};
use crate::{RetargetConfig, RetargetError, scene::survey};

dataflow::metrics! {
    /// What is said of an object's distances.
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
) -> Result<Outcome<FieldMetrics>, RetargetError> {
    let object = inputs
        .artifacts("objects")
        .first()
        .ok_or_else(|| missing(cx, "object"))?;
    let mesh = match read_mesh(object, cx)? {
        Ok(mesh) => mesh,
        Err(reason) => return Ok(Outcome::skipped(reason)),
    };
    let (field, info) = match survey(&mesh, config.field_spacing_m) {
        Ok(Some(surveyed)) => surveyed,
        Ok(None) => return Ok(Outcome::skipped("its mesh has no surface")),
        Err(err) => return Ok(Outcome::skipped(format!("its mesh: {err}"))),
    };
    let batch = distance_fields::to_batch(&info).map_err(schema(cx))?;
    lake::table::write(cx.folder(), &batch)?;
    let path = cx.folder().join(distance_fields::FIELD);
    let written = File::create_new(&path).and_then(|mut file| file.write_all(&field.to_bytes()));
    written.map_err(|source| RetargetError::WriteField {
        object: object.key.clone(),
        source,
    })?;
    let metrics = FieldMetrics {
        hull_vertices_n: info.hull_m.len() as f64,
    };
    Ok(Outcome::made(labels([("object", &object.key)]), metrics))
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
