//! Losses and learning rate over the epochs.

use cgf::{Description, Epoch, LatentPrior, Losses, TrainingConfig};
use charts::{Captions, Scale, Series, lines};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Max, Mean, OptionsUsed, Outcome, Output, Scope,
    Summary, Unit,
};
use lake::{LakeError, WriteArtifact};
use schemas::{
    Table,
    training::{EpochLosses, Split, Training},
};

use super::{description, of_description, shown, shown_split};
use crate::{BySplit, Train, TrainConfig};

/// A term of the loss: its name, its number, its weight.
type Term = (&'static str, fn(&Losses) -> f32, fn(&TrainingConfig) -> f64);

/// The terms that are weighted and summed.
const TERMS: [Term; 8] = [
    ("outputs", |losses| losses.q, |config| config.q_weight),
    (
        "translation",
        |losses| losses.translation,
        |config| config.translation_weight,
    ),
    (
        "link origins",
        |losses| losses.origins,
        |config| config.origins_weight,
    ),
    (
        "link rotations",
        |losses| losses.rotations,
        |config| config.rotations_weight,
    ),
    (
        "KL divergence",
        |losses| losses.kl,
        |config| config.kl_weight,
    ),
    (
        "contact",
        |losses| losses.contact,
        |config| config.contact_weight,
    ),
    (
        "penetration",
        |losses| losses.penetration,
        |config| config.penetration_weight,
    ),
    (
        "first decoder",
        |losses| losses.coarse,
        |config| config.q_weight,
    ),
];

dataflow::metrics! {
    /// Metrics of a training's losses.
    pub struct TrainingMetrics {
        /// Number of epochs.
        epochs: Max,
        /// Loss after the first epoch.
        loss_first: Option<Mean>,
        /// Loss of each set after the last epoch in which it was measured.
        loss: BySplit<Mean>,
        /// The epoch of the least loss of each set.
        least_epoch: BySplit<Max>,
        /// Least loss of the motions learned from.
        loss_least: Option<Mean>,
        /// Least loss of held-out motions.
        loss_held_out_least: Option<Mean>,
        /// Least loss of motions of unseen objects.
        loss_unseen_least: Option<Mean>,
    }
}

/// The report `training`: losses and learning rate over the epochs.
pub struct TrainingReport;

impl Output for TrainingReport {
    type Stage = Train;
    type Metrics = TrainingMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Training::NAME;
    const SCHEMA: &'static str = Training::VERSION;
    const PARTITION: &'static str = Training::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<TrainingMetrics>> = Some(line);

    fn units(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        of_description(config, scope)
    }

    /// Makes the table of losses and its charts.
    fn make(
        _config: &TrainConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrainingMetrics>, BoxedDiagnostic> {
        let description = description(inputs)?;
        let rows = rows(&description);
        cx.write(&rows)?;
        draw(&description, cx)?;
        let metrics = TrainingMetrics::of(&description.training_curve);
        Ok(Outcome::Made(metrics))
    }
}

fn line(summary: &Summary<TrainingMetrics>) -> String {
    let all = &summary.metrics;
    let epochs = dataflow::counted(all.epochs, "epoch");
    let (first, last) = (
        shown(all.loss_first, 4),
        shown(all.loss[Split::Training], 4),
    );
    let mut text = format!("{epochs}, loss {first} → {last}");
    for split in [Split::HeldOut, Split::Unseen] {
        if let Some(loss) = all.loss[split] {
            text += &format!(", {} {loss:.4}", shown_split(split));
        }
    }
    text
}

fn rows(description: &Description) -> Vec<EpochLosses> {
    let has_flow = description.network.prior == LatentPrior::Flow;
    let mut rows = Vec::new();
    for epoch in &description.training_curve {
        for split in Split::ALL {
            let Some(losses) = epoch.losses(split) else {
                continue;
            };
            rows.push(EpochLosses {
                epoch: number(epoch.epoch),
                split,
                learning_rate: epoch.learning_rate,
                total: losses.total.into(),
                q: losses.q.into(),
                translation: losses.translation.into(),
                origins_m2: losses.origins.into(),
                rotations: losses.rotations.into(),
                kl_nats: losses.kl.into(),
                contact_m2: losses.contact.into(),
                penetration_m2: losses.penetration.into(),
                coarse: losses.coarse.into(),
                prior: (has_flow && split == Split::Training).then_some(losses.prior.into()),
            });
        }
    }
    rows
}

fn number(epoch: usize) -> i64 {
    i64::try_from(epoch).unwrap_or(i64::MAX)
}

impl TrainingMetrics {
    fn of(curve: &[Epoch]) -> Self {
        let measured = |split: Split| {
            let epochs = curve.iter();
            epochs.filter_map(move |epoch| Some((epoch.epoch, epoch.losses(split)?.total)))
        };
        let minimum = |split| measured(split).min_by(|(_, a), (_, b)| a.total_cmp(b));
        let least = |split| Some(f64::from(minimum(split)?.1));
        Self {
            epochs: curve.len() as f64,
            loss_first: curve.first().map(|first| first.training.total.into()),
            loss: BySplit::of(|split| Some(f64::from(measured(split).next_back()?.1))),
            least_epoch: BySplit::of(|split| Some(minimum(split)?.0 as f64)),
            loss_least: least(Split::Training),
            loss_held_out_least: least(Split::HeldOut),
            loss_unseen_least: least(Split::Unseen),
        }
    }
}

fn draw(description: &Description, cx: &Context) -> Result<(), LakeError> {
    let curve = &description.training_curve;
    let captions = |title, y| Captions {
        title,
        x: "epoch",
        y,
    };
    let by_split = |number: fn(&Losses) -> f32| {
        let all = Split::ALL.map(|split| {
            let measured = curve.iter().filter_map(|epoch| {
                let losses = epoch.losses(split)?;
                Some([epoch.epoch as f64, number(losses).into()])
            });
            series(&shown_split(split), measured)
        });
        measured(all)
    };
    let loss = lines(
        &captions("Loss", "weighted sum"),
        Scale::Log,
        &by_split(|losses| losses.total),
    );
    cx.write_chart("loss", loss)?;
    let kl = lines(
        &captions("Divergence of the latent codes", "KL [nats]"),
        Scale::Linear,
        &by_split(|losses| losses.kl),
    );
    cx.write_chart("kl", kl)?;
    for (split, file, title) in [
        (Split::Training, "terms", "Terms of the loss, training"),
        (
            Split::HeldOut,
            "terms_held_out",
            "Terms of the loss, held-out motions",
        ),
        (
            Split::Unseen,
            "terms_unseen",
            "Terms of the loss, unseen objects",
        ),
    ] {
        let terms = TERMS.map(|(name, number, weight)| {
            let weight = weight(&description.training);
            let measured = curve.iter().filter_map(|epoch| {
                let weighted = weight * f64::from(number(epoch.losses(split)?));
                Some([epoch.epoch as f64, weighted])
            });
            series(name, measured.filter(|[_, weighted]| *weighted > 0.0))
        });
        let captions = captions(title, "weighted");
        cx.write_chart(file, lines(&captions, Scale::Log, &measured(terms)))?;
    }
    let rates = curve.iter();
    let rates = rates.map(|epoch| [epoch.epoch as f64, epoch.learning_rate]);
    let captions = captions("Learning rate", "learning rate");
    let rate = lines(&captions, Scale::Linear, &[series("learning rate", rates)]);
    cx.write_chart("learning_rate", rate)
}

fn series(name: &str, points: impl Iterator<Item = [f64; 2]>) -> Series {
    Series {
        name: name.to_owned(),
        points: points.collect(),
    }
}

/// Leaves out what was never measured.
fn measured<const N: usize>(all: [Series; N]) -> Vec<Series> {
    let mut all = Vec::from(all);
    all.retain(|series| !series.points.is_empty());
    all
}
