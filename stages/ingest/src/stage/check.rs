//! What is refused before anything is planned.

use std::collections::{BTreeMap, BTreeSet};

use schemas::demonstrations::Side;

use super::units;
use crate::{
    config::{IngestConfig, Landmarks},
    dexycb,
    error::IngestError,
    folders::plain,
    reader::{Listed, Reader},
    selection::{self, Cameras, Choice},
};

/// Refuses options with which nothing can be made.
pub(super) fn options(config: &IngestConfig) -> Result<(), IngestError> {
    let positive = [
        ("rate_hz", config.rate_hz),
        ("max_mirror_error_m", config.max_mirror_error_m),
        ("camera_agreement_m", config.camera_agreement_m),
        ("move_threshold_m", config.move_threshold_m),
        ("move_threshold_rad", config.move_threshold_rad),
        ("jitter_factor", config.jitter_factor),
        ("max_table_error_m", config.max_table_error_m),
        ("points_n", config.points_n as f64),
        ("max_convex_parts_n", config.max_convex_parts_n as f64),
        ("min_steps_n", config.min_steps_n as f64),
        ("settle_n", config.settle_n as f64),
    ];
    let masses = config.masses_kg.values().map(|&kg| ("masses_kg", kg));
    let added = config.meshes.values().map(|mesh| ("mass_kg", mesh.mass_kg));
    for (key, found) in positive.into_iter().chain(masses).chain(added) {
        if !(found.is_finite() && found > 0.0) {
            return Err(IngestError::Option {
                key,
                expected: "positive",
                found,
            });
        }
    }
    check_hand_models(config)?;
    for (object, mesh) in &config.meshes {
        if plain(object) != *object || object.is_empty() {
            return Err(IngestError::MeshName {
                name: object.clone(),
            });
        }
        if !mesh.file.is_file() {
            return Err(IngestError::NoMesh {
                object: object.clone(),
                path: mesh.file.clone(),
            });
        }
    }
    Ok(())
}

/// Refuses to begin without the hand models that the options ask for.
fn check_hand_models(config: &IngestConfig) -> Result<(), IngestError> {
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
    let mut paths = hands
        .into_iter()
        .map(|hand| folder.join(dexycb::model_file(hand)));
    match paths.find(|path| !path.is_file()) {
        Some(path) => Err(IngestError::NoHandModel { path }),
        None => Ok(()),
    }
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
    selection::check_known("masses_kg", config.masses_kg.keys(), &known)?;
    let is_told = |(listed, choice): &(Listed, Choice)| listed.about.is_some() && choice.is_taken();
    if chosen.iter().any(is_told) || !config.meshes.is_empty() {
        return Ok(());
    }
    let found = chosen.len();
    if let Some((listed, _)) = chosen.iter().find(|(_, choice)| choice.is_taken()) {
        let files = reader.files(listed, Cameras::ALL)?;
        if let Err(source) = reader.about(&files) {
            return Err(IngestError::NoneTold { found, source });
        }
    }
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for (_, choice) in chosen {
        if let Choice::Leave(reason) = choice {
            *reasons.entry(reason).or_default() += 1;
        }
    }
    Err(IngestError::NoneChosen { found, reasons })
}
