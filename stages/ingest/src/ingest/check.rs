//! Checks before planning.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use dataflow::SourceFile;
use schemas::demonstrations::Side;

use super::units;
use crate::{
    config::{Format, IngestConfig, Landmarks},
    dexycb,
    error::IngestError,
    folders::plain,
    place,
    reader::{ListedRecording, MAX_MESH_BYTES, Reader},
    selection::{self, Cameras, Selection},
};

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
