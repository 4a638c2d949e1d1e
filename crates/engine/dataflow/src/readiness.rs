//! Readiness of a pipeline's stages: their options and their files outside the lake.

use std::{collections::BTreeSet, fs, path::Path};

use crate::{error::Failure, pipeline::StageEntry, scope::Scope};

/// A stage's resources outside the lake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Readiness {
    /// Number of units of the stage's largest output, and what one of them stands for; `None` for a
    /// stage with inputs, whose units are only known once those are made.
    pub units: Option<(usize, &'static str)>,
    /// Number of files that the units of all its outputs read.
    pub n_files: usize,
}

/// Returns the resources outside the lake with which a stage can begin.
///
/// It prepares them, as before a plan. A stage without inputs lists its units too, and every file
/// that they read must exist.
///
/// # Errors
///
/// Fails if the stage cannot begin.
pub fn outside(stage: &StageEntry) -> Result<Readiness, Failure> {
    stage.prepare()?;
    Failure::of_files(stage.unusable_files())?;
    if !stage.kind.all_inputs().is_empty() {
        return Ok(Readiness {
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
    Ok(Readiness {
        units: Some(most),
        n_files: paths.len(),
    })
}
