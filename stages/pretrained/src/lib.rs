//! Offers a grasping function that is already trained, from two files, where a pipeline has no stage `train`.
//!
//! One unit: it reads weights and description as `train` writes them, checks that they fit together, and makes the
//! artifact `checkpoint` of them.

mod config;
mod error;

pub use config::PretrainedConfig;
pub use error::PretrainedError;

use std::fs;

use cgf::Cgf;
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Max, Outcome, Output, Outputs, Scope, SourceFile,
    Stage, Sum, Unit,
};
use lake::ReadInputs;
use schemas::checkpoint::{self, Files};

/// Offers a grasping function that is already trained.
pub struct Pretrained;

dataflow::metrics! {
    /// Metrics of a function that was trained elsewhere.
    pub struct PretrainedMetrics {
        /// Number of objects that it has learned from.
        objects: Sum,
        /// The epoch after which its weights were taken.
        epoch: Max,
    }
}

/// Key of the one partition.
const MODEL: &str = "cgf";

impl Stage for Pretrained {
    type Config = PretrainedConfig;

    const KIND: &'static str = "pretrained";
    const ABOUT: &'static str = "Offers a grasping function that is already trained";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];

    /// Checks that both files are there.
    fn prepare(config: &PretrainedConfig) -> Result<(), BoxedDiagnostic> {
        for (_, path) in config.files() {
            fs::metadata(&path).map_err(|source| PretrainedError::NoFile { path, source })?;
        }
        Ok(())
    }
}

impl Output for Pretrained {
    type Stage = Self;
    type Metrics = PretrainedMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = checkpoint::NAME;
    const SCHEMA: &'static str = checkpoint::VERSION;
    const PARTITION: &'static str = checkpoint::PARTITION;
    const LINE: Option<Line<PretrainedMetrics>> = Some(|summary| {
        let PretrainedMetrics { objects, epoch } = summary.metrics;
        format!("a function that has learned from {objects} objects, epoch {epoch}")
    });

    fn units(config: &PretrainedConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let files = config.files().into_iter();
        let unit = files.fold(Unit::new(MODEL), |unit, (name, path)| {
            unit.with_file(SourceFile::named(name, &path))
        });
        Ok(vec![unit])
    }

    /// A published function has one set of weights, so those of the best and of the last epoch are the same.
    fn make(
        _config: &PretrainedConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<PretrainedMetrics>, BoxedDiagnostic> {
        let file = |name: &'static str| inputs.source(name).map(|file| file.path.clone());
        let Files {
            weights,
            description,
        } = checkpoint::LAST;
        let cgf = Cgf::load(&file(weights)?, &file(description)?).map_err(PretrainedError::Cgf)?;
        for made in [checkpoint::BEST, checkpoint::LAST] {
            let path = |name| cx.folder().join(name);
            cgf.save(&path(made.weights), &path(made.description))
                .map_err(PretrainedError::Cgf)?;
        }
        Ok(Outcome::Made(PretrainedMetrics {
            objects: cgf.description().objects.len() as f64,
            epoch: cgf.description().epoch as f64,
        }))
    }
}

#[cfg(test)]
mod tests;
