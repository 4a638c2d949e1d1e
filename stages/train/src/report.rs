//! Shows how a training went, by the checkpoint of its last epoch.
//!
//! Three tables with charts: the losses (`training`), what is used of the latent code (`latents`), and
//! how near the motions of the mean codes are to those that they were encoded from
//! (`reconstruction`).

mod latents;
mod reconstruction;
mod training;

use cgf::Description;
use dataflow::{
    BoxedDiagnostic, Inputs, Lines, Outputs, PartitionKey, Report, Scope, Summary, Unit, counted,
};
use lake::{ReadArtifact, ReadInputs};
use schemas::{checkpoint, training::Split};

use crate::{Train, TrainConfig, TrainError, TrainMetrics, train::training_unit};

pub use latents::{LatentMetrics, LatentsReport};
pub use reconstruction::{ReconstructionMetrics, ReconstructionReport};
pub use training::{TrainingMetrics, TrainingReport};

/// Shows how a training went.
pub enum TrainReport {}

impl Report for TrainReport {
    type Stage = Train;

    const OUTPUTS: Outputs<Train> = &[&TrainingReport, &LatentsReport, &ReconstructionReport];

    fn lines(lines: &mut Lines<Train>) {
        lines.add::<Train>(line);
    }
}

fn line(summary: &Summary<TrainMetrics>) -> String {
    let all = &summary.metrics;
    let error_mm = |split: Split| shown(all.position_error_m[split].map(|m| 1e3 * m), 1);
    let n = shown(all.trajectories[Split::Training], 0);
    let error = error_mm(Split::Training);
    let trajectories = counted(n, "trajectory");
    let mut text = format!("{trajectories} → error {error} mm");
    for (split, what) in [(Split::HeldOut, "held out"), (Split::Unseen, "unseen")] {
        if let Some(n) = all.trajectories[split].filter(|n| *n > 0.0) {
            text += &format!(", {n} {what} {} mm", error_mm(split));
        }
    }
    text
}

/// Returns a figure with this many decimals; `unknown` if it is missing.
pub(crate) fn shown(figure: Option<f64>, decimals: usize) -> String {
    figure.map_or_else(
        || "unknown".to_owned(),
        |figure| format!("{figure:.decimals$}"),
    )
}

/// Units that read what a checkpoint says of itself.
pub(crate) fn of_description(
    config: &TrainConfig,
    scope: &Scope,
) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let files = [checkpoint::LAST.description];
    let trained = trained(config, scope)?;
    Ok(trained
        .map(|(_, model)| {
            Unit::new(&model)
                .reading(checkpoint::NAME, [&model])
                .only_files(checkpoint::NAME, files)
        })
        .collect())
}

/// Units that read a function and what it was trained on.
pub(crate) fn of_function(
    config: &TrainConfig,
    scope: &Scope,
) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let files = [checkpoint::LAST.description, checkpoint::LAST.weights];
    let trained = trained(config, scope)?;
    Ok(trained
        .map(|(unit, model)| {
            unit.reading(checkpoint::NAME, [&model])
                .only_files(checkpoint::NAME, files)
        })
        .collect())
}

/// The units that train and the checkpoints that they make.
fn trained(
    config: &TrainConfig,
    scope: &Scope,
) -> Result<impl Iterator<Item = (Unit, PartitionKey)>, BoxedDiagnostic> {
    let unit = training_unit(config, scope)?;
    let models = scope.partitions(checkpoint::NAME).iter();
    Ok(models.map(move |model| (unit.clone(), model.key.clone())))
}

/// Name of a split in charts.
pub(crate) fn shown_split(split: Split) -> String {
    let name = match split {
        Split::Training => "training",
        Split::HeldOut => "held out",
        Split::Unseen => "unseen objects",
    };
    name.to_owned()
}

/// Everything about the trained function but its weights.
pub(crate) fn description(inputs: &Inputs) -> Result<Description, BoxedDiagnostic> {
    let model = inputs.artifact(checkpoint::NAME)?;
    Ok(Description::read(model.path(checkpoint::LAST.description)?).map_err(TrainError::from)?)
}

/// The mean of numbers; not a number if there are none.
pub(crate) fn mean(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for number in numbers {
        sum += number;
        n += 1.0;
    }
    sum / n
}
