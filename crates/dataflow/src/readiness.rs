//! Readiness of a pipeline's stages: their options and their files outside the lake.

use std::{collections::BTreeSet, fs, path::Path};

use crate::{
    error::Failure,
    name::StageName,
    pipeline::{Pipeline, StageEntry},
    scope::Scope,
};

/// Whether one stage can begin.
#[derive(Debug)]
pub struct Readiness {
    /// The stage's name.
    pub stage: StageName,
    /// Its resources outside the lake, or why it cannot begin.
    pub found: Result<Outside, Failure>,
}

/// A stage's resources outside the lake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outside {
    /// Number of units of the stage's largest output, and what one of them stands for; `None` for a
    /// stage with inputs, whose units are only known once those are made.
    pub units: Option<(usize, &'static str)>,
    /// Number of files that the units of all its outputs read.
    pub n_files: usize,
}

/// Returns for each stage, in file order, whether it can begin.
///
/// Every stage prepares its resources outside the lake, as before a plan. A stage without inputs
/// lists its units too, and every file that they read must exist.
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
    for (idx, output) in stage.kind.outputs.iter().enumerate() {
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
