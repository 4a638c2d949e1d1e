//! The reports: their units, and what they have in common.

use cgf::{Demonstration, Description, Split};
use charts::ChartError;
use dataflow::{Code, Context, Inputs, Output, Report, Reported, Scope, Stage, Summary, Unit};
use lake::{ReadArtifact, ReadInputs, WriteArtifact};
use schemas::{
    Table, checkpoint, latents::Latents, reconstruction::Reconstruction, training::Training,
};
use stage_train::{CHECKPOINT, Train, TrainConfig};

use crate::{TrainReportError, latents, reconstruction, training};

/// Shows how a training went.
pub enum TrainReport {}

impl Report for TrainReport {
    type Stage = Train;
    type Error = TrainReportError;

    const CODE: Code = dataflow::code!();
    const OUTPUTS: &'static [Reported<Self>] = &[
        Reported {
            output: output("training", Training::VERSION),
            units: of_description,
            foretell: |_| None,
            run: |_, inputs, cx| training::make(inputs, cx),
            describe: training::describe,
        },
        Reported {
            output: output("latents", Latents::VERSION),
            units: of_description,
            foretell: |_| None,
            run: |_, inputs, cx| latents::make(inputs, cx),
            describe: latents::describe,
        },
        Reported {
            output: output("reconstruction", Reconstruction::VERSION),
            units: of_function,
            foretell: |_| None,
            run: reconstruction::make,
            describe: reconstruction::describe,
        },
    ];

    fn describe(_output: &str, summary: &Summary) -> String {
        let error_mm = |suffix| 1e3 * summary.total(&format!("position_error_m{suffix}"));
        let mut text = format!(
            "{} trajectories → error {:.1} mm",
            summary.total("trajectories"),
            error_mm(""),
        );
        for (suffix, what) in [("_held_out", "held out"), ("_unseen", "unseen")] {
            let n = summary.total(&format!("trajectories{suffix}"));
            if n > 0.0 {
                text += &format!(", {n} {what} {:.1} mm", error_mm(suffix));
            }
        }
        text
    }
}

const fn output(artifact: &'static str, schema: &'static str) -> Output {
    Output {
        artifact,
        schema,
        partition: "model",
        parallel: true,
    }
}

/// Units that read what a checkpoint says of itself.
fn of_description(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, TrainReportError> {
    let files = [checkpoint::LAST.description];
    let trained = trained(config, scope)?;
    Ok(trained
        .map(|(_, model)| {
            Unit::new(&model)
                .reading(CHECKPOINT, [&model])
                .only_files(CHECKPOINT, files)
        })
        .collect())
}

/// Units that read a function and what it was trained on.
fn of_function(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, TrainReportError> {
    let files = [checkpoint::LAST.description, checkpoint::LAST.weights];
    let trained = trained(config, scope)?;
    Ok(trained
        .map(|(unit, model)| {
            unit.reading(CHECKPOINT, [&model])
                .only_files(CHECKPOINT, files)
        })
        .collect())
}

/// The units that train and the checkpoints that they make.
fn trained(
    config: &TrainConfig,
    scope: &Scope,
) -> Result<impl Iterator<Item = (Unit, String)>, TrainReportError> {
    let units = Train::units(config, CHECKPOINT, scope)?.into_iter();
    let models = scope.partitions(CHECKPOINT).iter();
    Ok(units.zip(models.map(|model| model.key.clone())))
}

/// Sets of motions: what tables call them, what charts call them, and the end of their figures' names.
pub(crate) const SPLITS: [(Split, &str, &str, &str); 3] = [
    (Split::Training, "training", "training", ""),
    (Split::HeldOut, "held_out", "held out", "_held_out"),
    (Split::Unseen, "unseen", "unseen objects", "_unseen"),
];

/// Everything about the trained function but its weights.
pub(crate) fn description(inputs: &Inputs) -> Result<Description, TrainReportError> {
    let model = inputs.artifact(CHECKPOINT)?;
    Ok(Description::read(
        model.path(checkpoint::LAST.description)?,
    )?)
}

/// The motions of a set.
pub(crate) fn of_split(
    description: &Description,
    split: Split,
) -> impl Iterator<Item = &Demonstration> {
    let demonstrations = description.demonstrations.iter();
    demonstrations.filter(move |demonstration| demonstration.split == split)
}

/// Writes a chart; one in which there is nothing to draw is left out.
pub(crate) fn put(
    cx: &Context,
    name: &str,
    chart: Result<String, ChartError>,
) -> Result<(), TrainReportError> {
    match chart {
        Ok(svg) => Ok(cx.write_file(&format!("{name}.svg"), svg.as_bytes())?),
        Err(ChartError::Nothing { .. }) => Ok(()),
        Err(err) => Err(err.into()),
    }
}

/// `3 motions` or `1 motion`.
pub(crate) fn counted(n: f64, what: &str) -> String {
    let end = if n < 1.5 { "" } else { "s" };
    format!("{n} {what}{end}")
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
