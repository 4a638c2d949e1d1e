//! Checks before planning.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use dataflow::{OptionFault, OptionFaults, SourceFile};
use schemas::demonstrations::Side;

use super::units;
use crate::{
    config::{Format, IngestConfig, Landmarks, MAX_RATE_HZ},
    dexycb,
    error::IngestError,
    folders::plain,
    place,
    reader::{ListedRecording, MAX_MESH_BYTES, Reader},
    selection::{self, Cameras, Selection},
};

/// Maximum number of images of a recording that options speak of: nine hours at 30 per second.
const MAX_IMAGES: usize = 1_000_000;
/// Maximum number of points on a surface: 48 MB of them with their normals.
const MAX_SURFACE_POINTS: usize = 1_000_000;
/// Maximum number of convex parts of an object.
const MAX_PARTS: usize = 4096;
/// Maximum number of objects of a scene.
const MAX_OBJECTS: usize = 1000;
/// Greatest length, angle, factor or mass.
const MAX_SETTING: f64 = 1e6;

/// Returns what is wrong with the options beyond their types.
pub(super) fn faults(config: &IngestConfig) -> Vec<OptionFault> {
    let mut faults = OptionFaults::default();
    let why = "no camera that films a whole hand is faster";
    if let Some(rate_hz) = config.rate_hz {
        faults.above("rate_hz", rate_hz, 0.0, MAX_RATE_HZ, why);
    }
    for (key, number) in [
        ("max_mirror_error_m", config.max_mirror_error_m),
        ("camera_agreement_m", config.camera_agreement_m),
        ("move_threshold_m", config.move_threshold_m),
        ("move_threshold_rad", config.move_threshold_rad),
        ("jitter_factor", config.jitter_factor),
        ("max_table_error_m", config.max_table_error_m),
    ] {
        let why = "0 tolerates no noise, and a larger value exceeds any scene";
        faults.above(key, number, 0.0, MAX_SETTING, why);
    }
    for (key, number, least) in [
        ("settle_n", config.settle_n, 1),
        ("max_gap_n", config.max_gap_n, 0),
        ("min_steps_n", config.min_steps_n, 1),
    ] {
        let why = "it counts images of a recording";
        faults.within(key, number, least..=MAX_IMAGES, why);
    }
    let objects = config.min_table_objects_n;
    let why = "the grasped object counts, and no table holds more";
    faults.within("min_table_objects_n", objects, 1..=MAX_OBJECTS, why);
    let why = "they are sampled and held in memory for each object";
    faults.within("points_n", config.points_n, 1..=MAX_SURFACE_POINTS, why);
    let why = "each is a collision shape in every physics step";
    let parts = config.max_convex_parts_n;
    faults.within("max_convex_parts_n", parts, 1..=MAX_PARTS, why);
    let masses = config.masses_kg.iter();
    let masses = masses.map(|(object, &kg)| (format!("masses_kg.{object}"), kg));
    let meshes = config.meshes.iter();
    let added = meshes.map(|(object, mesh)| (format!("meshes.{object}.mass_kg"), mesh.mass_kg));
    for (key, kg) in masses.chain(added) {
        let why = "it is the mass of an object that a hand lifts";
        faults.above(&key, kg, 0.0, MAX_SETTING, why);
    }
    faults.found()
}

/// Refuses options that name files that are not there.
pub(super) fn options(config: &IngestConfig) -> Result<(), IngestError> {
    check_hand_models(config)?;
    for (object, mesh) in &config.meshes {
        if plain(object) != *object || object.is_empty() {
            return Err(IngestError::MeshName {
                name: object.clone(),
            });
        }
        let found = place::find(outside(&mesh.file), MAX_MESH_BYTES);
        let found = found.map_err(|source| IngestError::Mesh {
            object: object.clone(),
            source,
        })?;
        found.ok_or_else(|| IngestError::NoMesh {
            object: object.clone(),
            path: mesh.file.clone(),
        })?;
    }
    Ok(())
}

/// Refuses to begin without the hand models that the options ask for, or where the dataset has no poses of them.
fn check_hand_models(config: &IngestConfig) -> Result<(), IngestError> {
    if config.format != Format::DexYcb {
        return match config.landmarks {
            Landmarks::Mano => Err(IngestError::NoHandPoses),
            Landmarks::Either | Landmarks::Labels => Ok(()),
        };
    }
    let Some(folder) = &config.mano_models else {
        return match config.landmarks {
            Landmarks::Mano => Err(IngestError::NoHandModels),
            Landmarks::Either | Landmarks::Labels => Ok(()),
        };
    };
    let hands = match (config.mirror, config.hand) {
        (true, _) => vec![Side::Right, Side::Left],
        (false, hand) => vec![hand],
    };
    for hand in hands {
        let path = folder.join(dexycb::model_file(hand));
        let found = place::find(outside(&path), dexycb::MAX_MODEL_BYTES);
        let found = found.map_err(IngestError::HandModel)?;
        found.ok_or(IngestError::NoHandModel { path })?;
    }
    Ok(())
}

/// Returns a file that is none of the dataset's and is told by its path.
fn outside(path: &Path) -> SourceFile {
    SourceFile::new(path.display().to_string(), path.to_owned())
}

/// Refuses to begin where the options leave out every recording, or none can be told what it is about.
pub(super) fn chosen(config: &IngestConfig, reader: &dyn Reader) -> Result<(), IngestError> {
    let chosen = units::chosen(config, reader)?;
    let scenes = chosen
        .iter()
        .filter_map(|(listed, _)| listed.about.as_ref());
    let known: BTreeSet<&str> = scenes
        .flat_map(|about| about.scene.iter().chain([&about.object]))
        .chain(config.meshes.keys())
        .map(String::as_str)
        .collect();
    let masses = selection::check_known("masses_kg", config.masses_kg.keys(), &known);
    masses.map_err(|err| units::hidden(err, reader, chosen.iter().map(|(listed, _)| listed)))?;
    let is_told = |(listed, choice): &(ListedRecording, Selection)| {
        listed.about.is_some() && choice.is_taken()
    };
    if chosen.iter().any(is_told) || !config.meshes.is_empty() {
        return Ok(());
    }
    let found = chosen.len();
    if let Some((listed, _)) = chosen.iter().find(|(_, choice)| choice.is_taken()) {
        let files = reader.files(listed, Cameras::ALL);
        if let Err(source) = files.and_then(|files| reader.about(&files)) {
            return Err(IngestError::NoneTold { found, source });
        }
    }
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for (_, choice) in chosen {
        if let Selection::Leave(reason) = choice {
            *reasons.entry(reason).or_default() += 1;
        }
    }
    Err(IngestError::NoneChosen { found, reasons })
}
