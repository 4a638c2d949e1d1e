//! Units: what there is to make, and from which files.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{BoxedDiagnostic, Output, Scope, SourceFile, Unit};
use geometry::MeshFormat;
use schemas::demonstrations::TERMS;

use super::{ADDED, Demonstrations, LEFT_OUT, MASS, MESHES, Shapes, UNREADABLE};
use crate::{
    config::IngestConfig,
    error::{IngestError, RecordingError},
    place,
    reader::{self, ListedRecording, MAX_MESH_BYTES, Reader},
    selection::{self, Cameras, Selection},
    terms, ycb,
};

/// The recordings that are listed, each with what becomes of it.
pub(super) fn chosen(
    config: &IngestConfig,
    reader: &dyn Reader,
) -> Result<Vec<(ListedRecording, Selection)>, IngestError> {
    let listed = reader.list()?;
    let choices = selection::choose(config, &listed).map_err(|err| hidden(err, reader, &listed))?;
    Ok(listed.into_iter().zip(choices).collect())
}

/// Returns why names or trials are missing: where a recording cannot say what it is about, that is the reason.
pub(super) fn hidden<'a>(
    err: IngestError,
    reader: &dyn Reader,
    listed: impl IntoIterator<Item = &'a ListedRecording>,
) -> IngestError {
    let untold = listed.into_iter().filter(|listed| listed.about.is_none());
    let fault = untold.filter_map(|listed| {
        let files = reader.files(listed, Cameras::ALL);
        files.and_then(|files| reader.about(&files)).err()
    });
    match (fault.into_iter().next(), err) {
        (Some(source), err @ (IngestError::UnknownName { .. } | IngestError::Trials { .. })) => {
            IngestError::Untold {
                problem: err.to_string(),
                source: Box::new(source),
            }
        }
        (_, err) => err,
    }
}

/// Lists one unit per object that is grasped, that says where a table is, or that the pipeline file
/// adds.
pub(super) fn shapes(config: &IngestConfig) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let reader = reader::reader(config);
    let mut names: BTreeSet<String> = config.meshes.keys().cloned().collect();
    for (listed, choice) in chosen(config, reader.as_ref())? {
        let (Some(about), Selection::Take(_)) = (listed.about, choice) else {
            continue;
        };
        if !listed.marks_table {
            // What only stands there is no loss if nobody knows its shape.
            let scene = about.scene.into_iter();
            names.extend(scene.filter(|name| !matches!(mesh_file(config, name), Ok(None))));
        }
        names.insert(about.object);
    }
    names
        .into_iter()
        .map(|object| {
            // Said before anything is computed, not after.
            let mass_kg = mass_kg(config, &object)?;
            let file = mesh_file(config, &object);
            let mut unit = Unit::new(&object)
                .with_label("object", &object)
                .with_fact(MASS, mass_kg.to_string());
            if config.meshes.contains_key(&object) {
                unit = unit.with_label(ADDED, "true");
            }
            match file {
                Ok(Some(file)) => unit.files.push(file),
                Ok(None) => {
                    let file = reader::mesh_name(config.format, &object);
                    let missing = RecordingError::Missing { file };
                    unit = unit.with_fact(UNREADABLE, missing.to_string());
                }
                Err(unusable) => unit = unit.with_fact(UNREADABLE, unusable.to_string()),
            }
            Ok(unit)
        })
        .collect()
}

/// Returns the pipeline file's mesh of an object, or the dataset's, if there is one.
///
/// # Errors
///
/// Fails if something else lies in its place.
fn mesh_file(config: &IngestConfig, object: &str) -> Result<Option<SourceFile>, RecordingError> {
    if let Some(added) = config.meshes.get(object) {
        // It was looked at before anything was planned.
        let format = MeshFormat::of(&added.file).unwrap_or(MeshFormat::Obj);
        let name = format!("{MESHES}{object}.{}", format.extension());
        return Ok(Some(SourceFile::new(name, added.file.clone())));
    }
    let name = reader::mesh_name(config.format, object);
    let path = config.root.join(&name);
    place::find(SourceFile::new(name, path), MAX_MESH_BYTES)
}

fn mass_kg(config: &IngestConfig, object: &str) -> Result<f64, IngestError> {
    let added = config.meshes.get(object).map(|mesh| mesh.mass_kg);
    added
        .or_else(|| config.masses_kg.get(object).copied())
        .or_else(|| ycb::mass_kg(object))
        .ok_or_else(|| IngestError::UnknownMass {
            object: object.to_owned(),
        })
}

pub(super) fn demonstrations(
    config: &IngestConfig,
    scope: &Scope,
) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let reader = reader::reader(config);
    let terms = terms::of_dataset(&config.root).map_err(IngestError::Terms)?;
    let shapes: BTreeSet<&str> = scope
        .partitions(Shapes::ARTIFACT)
        .iter()
        .map(|s| s.key.as_str())
        .collect();
    let units = chosen(config, reader.as_ref())?
        .into_iter()
        .map(|(listed, choice)| match (&listed.fault, choice) {
            (Some(fault), _) => unreadable(&listed.key, fault),
            (None, Selection::Leave(reason)) => {
                // What it is about is all that is read of it.
                recording(&listed, terms.as_deref())
                    .with_fact(LEFT_OUT, reason)
                    .with_file(listed.file(reader.description()))
            }
            (None, Selection::Take(cameras)) => {
                let files = match reader.files(&listed, cameras) {
                    Ok(files) => files,
                    Err(unusable) => return unreadable(&listed.key, &unusable),
                };
                let mut unit = recording(&listed, terms.as_deref());
                unit.files = files;
                let object = listed.about.as_ref().map(|about| about.object.as_str());
                // What is wrong with a mesh is told where its shape is made.
                let mesh = object.and_then(|object| mesh_file(config, object).ok().flatten());
                unit.files.extend(mesh);
                let read = listed.about.iter().flat_map(|about| {
                    let scene = about.scene.iter().filter(|_| !listed.marks_table);
                    let mirrored = (about.hand != config.hand).then_some(&about.object);
                    scene.chain(mirrored).map(String::as_str)
                });
                let read: BTreeSet<&str> = read.filter(|name| shapes.contains(name)).collect();
                if read.is_empty() {
                    unit
                } else {
                    unit.reading(Shapes::ARTIFACT, read)
                }
            }
        });
    Ok(units.collect())
}

/// Returns the unit of a recording, with its labels.
fn recording(listed: &ListedRecording, terms: Option<&str>) -> Unit {
    let unit = Unit::new(&listed.key);
    let unit = match terms {
        Some(terms) => unit.with_label(TERMS, terms),
        None => unit,
    };
    match &listed.about {
        Some(about) => unit
            .with_label("object", &about.object)
            .with_label("subject", &about.subject),
        None => unit.labeled_by_data(),
    }
}

/// Returns a unit that only says why its recording cannot be read.
fn unreadable(key: &str, why: &RecordingError) -> Unit {
    Unit::new(key)
        .with_fact(UNREADABLE, why.to_string())
        .labeled_by_data()
}

/// Lists one unit per shape that is grasped in a demonstration or that the pipeline file adds.
pub(super) fn objects(scope: &Scope) -> Vec<Unit> {
    let mut by_object: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for demonstration in scope.partitions(Demonstrations::ARTIFACT) {
        if let Some(object) = demonstration.label("object") {
            by_object
                .entry(object)
                .or_default()
                .push(demonstration.key.as_str());
        }
    }
    let shapes = scope.partitions(Shapes::ARTIFACT).iter();
    shapes
        .filter_map(|shape| {
            let unit = Unit::new(&shape.key)
                .with_label("object", &shape.key)
                .reading(Shapes::ARTIFACT, [&shape.key]);
            match by_object.remove(shape.key.as_str()) {
                Some(keys) => Some(unit.reading(Demonstrations::ARTIFACT, keys)),
                None => shape.label(ADDED).is_some().then_some(unit),
            }
        })
        .collect()
}
