//! What shows how a training went: tables and charts made of the checkpoint of its last epoch.

mod latents;
mod reconstruction;
mod training;

use std::path::Path;

use cgf::{Demonstration, Description, Split};
use charts::ChartError;
use dataflow::{Artifact, Context, Inputs, Outcome, Scope, Summary, Unit};
use lake::LakeError;
use schemas::checkpoint;

use crate::{TrainConfig, TrainError};

/// The artifact of the trained function.
pub(crate) const CHECKPOINT: &str = "checkpoint";
/// The artifact of its losses over the epochs.
pub(crate) const TRAINING: &str = "training";
/// The artifact of how near its motions are to those that it learned from.
pub(crate) const RECONSTRUCTION: &str = "reconstruction";
/// The artifact of what is used of its latent code.
pub(crate) const LATENTS: &str = "latents";

/// Sets of motions: what tables call them, what charts call them, and the end of their figures' names.
const SPLITS: [(Split, &str, &str, &str); 3] = [
    (Split::Training, "training", "training", ""),
    (Split::HeldOut, "held_out", "held out", "_held_out"),
    (Split::Unseen, "unseen", "unseen objects", "_unseen"),
];

/// The unit that shows a training, of the unit that trains.
pub(crate) fn units(output: &str, trains: &Unit, scope: &Scope) -> Vec<Unit> {
    let models = scope.partitions(CHECKPOINT).iter();
    models
        .map(|model| {
            let (unit, files) = if output == RECONSTRUCTION {
                let last = [checkpoint::LAST.description, checkpoint::LAST.weights];
                (trains.clone(), last.to_vec())
            } else {
                let last = [checkpoint::LAST.description];
                (Unit::new(&model.key), last.to_vec())
            };
            unit.reading(CHECKPOINT, [&model.key])
                .only_files(CHECKPOINT, files)
        })
        .collect()
}

/// Makes what shows a training.
pub(crate) fn make(
    config: &TrainConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, TrainError> {
    match cx.output() {
        RECONSTRUCTION => reconstruction::make(config, inputs, cx),
        LATENTS => latents::make(inputs, cx),
        _ => training::make(inputs, cx),
    }
}

/// Says what became of it.
pub(crate) fn describe(output: &str, summary: &Summary) -> String {
    match output {
        RECONSTRUCTION => reconstruction::describe(summary),
        LATENTS => latents::describe(summary),
        _ => training::describe(summary),
    }
}

/// The file of the checkpoint that has this name.
fn file<'a>(inputs: &'a Inputs, name: &str) -> Result<&'a Path, TrainError> {
    let model = inputs.artifacts(CHECKPOINT).first();
    let file = model.and_then(|model| model.file(name));
    Ok(file.ok_or_else(|| LakeError::MissingFile {
        key: model.map_or_else(String::new, |model: &Artifact| model.key.clone()),
        file: name.to_owned(),
    })?)
}

/// Everything about the trained function but its weights.
fn description(inputs: &Inputs) -> Result<Description, TrainError> {
    Ok(Description::read(file(
        inputs,
        checkpoint::LAST.description,
    )?)?)
}

/// The motions of a set.
fn of_split(description: &Description, split: Split) -> impl Iterator<Item = &Demonstration> {
    let demonstrations = description.demonstrations.iter();
    demonstrations.filter(move |demonstration| demonstration.split == split)
}

/// Writes a chart; one in which there is nothing to draw is left out.
fn put(cx: &Context, name: &str, chart: Result<String, ChartError>) -> Result<(), TrainError> {
    match chart {
        Ok(svg) => {
            let path = cx.folder().join(format!("{name}.svg"));
            Ok(lake::write_whole(&path, svg.as_bytes())?)
        }
        Err(ChartError::Nothing { .. }) => Ok(()),
        Err(err) => Err(err.into()),
    }
}

/// `3 motions` or `1 motion`.
fn counted(n: f64, what: &str) -> String {
    let end = if n < 1.5 { "" } else { "s" };
    format!("{n} {what}{end}")
}

/// The mean of numbers; not a number if there are none.
fn mean(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for number in numbers {
        sum += number;
        n += 1.0;
    }
    sum / n
}
