//! Whether the stages of a pipeline can begin: their options, and what they read outside the lake.

use std::{collections::BTreeSet, fs, path::Path};

use crate::{
    error::Failure,
    pipeline::{Pipeline, StageEntry},
    stage::Scope,
};

/// Whether one stage can begin.
#[derive(Debug)]
pub struct Readiness {
    /// The stage's name.
    pub stage: String,
    /// What it finds outside the lake, or why it cannot begin.
    pub found: Result<Outside, Failure>,
}

/// What a stage finds outside the lake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outside {
    /// Units of its first output; `None` for a stage that reads other stages, whose units are only
    /// known when those have run.
    pub n_units: Option<usize>,
    /// Files that these units read.
    pub n_files: usize,
}

/// Tells for each stage, in the order of the file, whether it can begin.
///
/// Every stage makes ready what lies outside the lake, as it does before a plan. A stage without
/// inputs lists its units too, and every file that they read must be there.
pub fn readiness(pipeline: &Pipeline) -> Vec<Readiness> {
    pipeline
        .stages
        .iter()
        .map(|stage| Readiness {
            stage: stage.name.clone(),
            found: outside(stage),
        })
        .collect()
}

fn outside(stage: &StageEntry) -> Result<Outside, Failure> {
    stage.prepare()?;
    let first = stage.kind.outputs.first();
    let Some(first) = first.filter(|_| stage.kind.inputs.is_empty()) else {
        return Ok(Outside {
            n_units: None,
            n_files: 0,
        });
    };
    let units = stage.units(first.artifact, &Scope::default())?;
    let files = units.iter().flat_map(|unit| &unit.files);
    let paths: BTreeSet<&Path> = files.map(|file| file.path.as_path()).collect();
    for path in &paths {
        fs::metadata(path).map_err(|source| Failure::SourceFile {
            path: (*path).to_owned(),
            source,
        })?;
    }
    Ok(Outside {
        n_units: Some(units.len()),
        n_files: paths.len(),
    })
}
