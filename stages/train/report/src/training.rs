//! Losses and learning rate over the epochs.

use std::collections::BTreeMap;

use cgf::{Description, Epoch, Losses, Split, TrainingConfig};
use charts::{Captions, Scale, Series, lines};
use dataflow::{Context, Inputs, Made, Outcome, Summary};
use lake::WriteArtifact;
use schemas::training::Row;

use crate::{
    TrainReportError,
    report::{SPLITS, counted, description, put},
};

/// A term of the loss: its name, its number, its weight.
type Term = (&'static str, fn(&Losses) -> f32, fn(&TrainingConfig) -> f64);

/// The terms that are weighted and summed.
const TERMS: [Term; 7] = [
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
];

/// Makes the table of losses and its charts.
pub(crate) fn make(inputs: &Inputs, cx: &Context) -> Result<Outcome, TrainReportError> {
    let description = description(inputs)?;
    let rows = rows(&description.training_curve);
    cx.write(&rows)?;
    draw(&description, cx)?;
    Ok(Outcome::Made(Made {
        labels: BTreeMap::new(),
        metrics: metrics(&description.training_curve),
    }))
}

pub(crate) fn describe(summary: &Summary) -> String {
    let loss = |name: &str| summary.total(&format!("loss{name}"));
    let epochs = counted(summary.total("epochs"), "epoch");
    let mut text = format!("{epochs}, loss {:.4} → {:.4}", loss("_first"), loss(""));
    for (_, _, name, suffix) in &SPLITS[1..] {
        if summary.totals.contains_key(&format!("loss{suffix}")) {
            text += &format!(", {name} {:.4}", loss(suffix));
        }
    }
    text
}

/// The losses of a set of motions, where they were measured.
fn losses(epoch: &Epoch, split: Split) -> Option<&Losses> {
    match split {
        Split::Training => Some(&epoch.training),
        Split::HeldOut => epoch.held_out.as_ref(),
        Split::Unseen => epoch.unseen.as_ref(),
    }
}

fn rows(curve: &[Epoch]) -> Vec<Row> {
    let mut rows = Vec::new();
    for epoch in curve {
        for (split, name, ..) in SPLITS {
            let Some(losses) = losses(epoch, split) else {
                continue;
            };
            rows.push(Row {
                epoch: number(epoch.epoch),
                split: name.to_owned(),
                learning_rate: epoch.learning_rate,
                total: losses.total.into(),
                q: losses.q.into(),
                translation: losses.translation.into(),
                origins_m2: losses.origins.into(),
                rotations: losses.rotations.into(),
                kl_nats: losses.kl.into(),
                contact_m2: losses.contact.into(),
                penetration_m2: losses.penetration.into(),
            });
        }
    }
    rows
}

fn number(epoch: usize) -> i64 {
    i64::try_from(epoch).unwrap_or(i64::MAX)
}

/// Each set's loss after the last epoch in which it was measured, and the least.
fn metrics(curve: &[Epoch]) -> BTreeMap<String, f64> {
    let mut metrics = BTreeMap::from([("epochs".to_owned(), curve.len() as f64)]);
    if let Some(first) = curve.first() {
        metrics.insert("loss_first".to_owned(), first.training.total.into());
    }
    for (split, _, _, suffix) in SPLITS {
        let measured = curve
            .iter()
            .filter_map(|epoch| Some((epoch.epoch, f64::from(losses(epoch, split)?.total))));
        let Some((_, last)) = measured.clone().next_back() else {
            continue;
        };
        metrics.insert(format!("loss{suffix}"), last);
        if let Some((epoch, least)) = measured.min_by(|(_, a), (_, b)| a.total_cmp(b)) {
            metrics.insert(format!("loss{suffix}_least"), least);
            metrics.insert(format!("least_epoch{suffix}"), epoch as f64);
        }
    }
    metrics
}

fn draw(description: &Description, cx: &Context) -> Result<(), TrainReportError> {
    let curve = &description.training_curve;
    let captions = |title, y| Captions {
        title,
        x: "epoch",
        y,
    };
    let by_split = |number: fn(&Losses) -> f32| {
        let all = SPLITS.map(|(split, _, name, _)| {
            let measured = curve.iter().filter_map(|epoch| {
                let losses = losses(epoch, split)?;
                Some([epoch.epoch as f64, number(losses).into()])
            });
            series(name, measured)
        });
        measured(all)
    };
    let loss = lines(
        &captions("Loss", "weighted sum"),
        Scale::Log,
        &by_split(|losses| losses.total),
    );
    put(cx, "loss", loss)?;
    let kl = lines(
        &captions("Divergence of the latent codes", "KL [nats]"),
        Scale::Linear,
        &by_split(|losses| losses.kl),
    );
    put(cx, "kl", kl)?;
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
                let weighted = weight * f64::from(number(losses(epoch, split)?));
                Some([epoch.epoch as f64, weighted])
            });
            series(name, measured.filter(|_| weight > 0.0))
        });
        let captions = captions(title, "weighted");
        put(cx, file, lines(&captions, Scale::Log, &measured(terms)))?;
    }
    let rates = curve.iter();
    let rates = rates.map(|epoch| [epoch.epoch as f64, epoch.learning_rate]);
    let captions = captions("Learning rate", "learning rate");
    let rate = lines(&captions, Scale::Linear, &[series("learning rate", rates)]);
    put(cx, "learning_rate", rate)
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
