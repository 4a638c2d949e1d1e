//! The bundled sample: recordings that are generated before `ingest` reads them.

use std::path::PathBuf;

use dataflow::Diagnostic;
use demonstrator::DemonstratorError;
use stage_ingest::IngestConfig;

/// Why the sample could not be made.
#[derive(Debug, thiserror::Error)]
#[error("cannot make the sample in `{}`", root.display())]
pub(crate) struct SampleError {
    root: PathBuf,
    source: DemonstratorError,
}

impl Diagnostic for SampleError {
    fn hint(&self) -> Option<String> {
        self.source.hint()
    }
}

/// Generates the dataset of a stage `ingest` if its folder holds a recipe.
pub(crate) fn generate(config: &IngestConfig) -> Result<(), SampleError> {
    // Its presence marks a generated dataset.
    if !config.root.join(demonstrator::RECIPE_FILE).is_file() {
        return Ok(());
    }
    let made = demonstrator::ensure_sample(&config.root, dataflow::code!("demonstrator").parts);
    made.map(drop).map_err(|source| SampleError {
        root: config.root.clone(),
        source,
    })
}
