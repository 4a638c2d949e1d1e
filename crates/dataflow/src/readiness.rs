//! Whether the stages of a pipeline can begin: their options, and what they read outside the lake.

use std::{collections::BTreeSet, fs, path::Path};

use crate::{
    error::Failure,
    pipeline::{Pipeline, StageEntry},
    scope::Scope,
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
    /// Units of the output that has the most of them, and what one of them stands for; `None` for a
    /// stage that reads other stages, whose units are only known when those have run.
    pub units: Option<(usize, &'static str)>,
    /// Files that the units of all its outputs read.
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
    if !stage.kind.inputs.is_empty() {
        return Ok(Outside {
            units: None,
            n_files: 0,
        });
    }
    let (mut units, mut most) = (Vec::new(), (0, ""));
    for (idx, output) in stage.kind.outputs().iter().enumerate() {
        let listed = stage.units(idx, &Scope::default())?;
        if listed.len() > most.0 {
            most = (listed.len(), output.partition);
        }
        units.extend(listed);
    }
    let files = units.iter().flat_map(|unit| &unit.files);
    let paths: BTreeSet<&Path> = files.map(|file| file.path.as_path()).collect();
    for path in &paths {
        fs::metadata(path).map_err(|source| Failure::SourceFile {
            path: (*path).to_owned(),
            source,
        })?;
    }
    Ok(Outside {
        units: Some(most),
        n_files: paths.len(),
    })
}
