//! Learning curves of the training.

use charts::{Captions, Scale, Series, lines};
use schemas::training::{EpochLosses, Split};

use crate::{
    PageData,
    table::{Cell, DataTable, Section},
};

/// Splits in the order in which they are shown.
const SPLITS: [Split; 3] = [Split::Training, Split::HeldOut, Split::Unseen];
/// Most points of a curve.
const POINTS: usize = 200;

fn word(split: Split) -> &'static str {
    match split {
        Split::Training => "training",
        Split::HeldOut => "held out",
        Split::Unseen => "unseen objects",
    }
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("training", "Training");
    if gathered.training.is_empty() {
        section.say("No training is wired to this report.");
        return section;
    }
    section.say(
        "Losses are means over motions. Training motions are measured as they were seen, turned and with noise; the \
         others as they were recorded.",
    );
    section.tables.push(table(gathered));
    let total = Captions {
        title: "Total loss",
        x: "epoch",
        y: "loss",
    };
    section.chart(
        "Weighted sum of the losses by epoch",
        curves(gathered, &total, |row| row.total),
    );
    let divergence = Captions {
        title: "Divergence of latent codes",
        x: "epoch",
        y: "divergence [nat]",
    };
    section.chart(
        "Divergence of the latent codes by epoch",
        curves(gathered, &divergence, |row| row.kl_nats),
    );
    section
}

/// Returns the losses of the motions of a split, epoch after epoch.
fn losses(gathered: &PageData, split: Split) -> impl DoubleEndedIterator<Item = &EpochLosses> {
    let rows = gathered.training.iter();
    rows.filter(move |row| row.split == split)
}

/// Returns the losses of each split at the last epoch, and the least.
fn table(gathered: &PageData) -> DataTable {
    let mut table = DataTable::new(
        "training",
        "Losses of the last epoch, and the least",
        &[
            ("split", "Motions"),
            ("epochs_n", "Epochs"),
            ("total", "Total"),
            ("total_least", "Least total"),
            ("total_least_epoch", "At epoch"),
            ("kl_nats", "KL [nat]"),
            ("penetration_m2", "Penetration [m²]"),
        ],
    );
    for split in SPLITS {
        let Some(end) = losses(gathered, split).next_back() else {
            continue;
        };
        let least = losses(gathered, split).min_by(|a, b| a.total.total_cmp(&b.total));
        let least = least.unwrap_or(end);
        let figure = |number: f64| Cell::Number(number, format!("{number:.3e}"));
        table.row([
            Cell::text(word(split)),
            Cell::count(end.epoch),
            figure(end.total),
            figure(least.total),
            Cell::count(least.epoch),
            Cell::Number(end.kl_nats, format!("{:.2}", end.kl_nats)),
            figure(end.penetration_m2),
        ]);
    }
    table
}

/// Draws a number by epoch, a curve for each split that has losses.
fn curves(
    gathered: &PageData,
    captions: &Captions,
    number: fn(&EpochLosses) -> f64,
) -> Option<String> {
    let series: Vec<Series> = SPLITS
        .into_iter()
        .filter(|split| losses(gathered, *split).next().is_some())
        .map(|split| {
            let points: Vec<[f64; 2]> = losses(gathered, split)
                .map(|row| [row.epoch as f64, number(row)])
                .collect();
            let stride = points.len().div_ceil(POINTS).max(1);
            let last = points.len().saturating_sub(1);
            let kept = points.into_iter().enumerate();
            let kept = kept.filter(|(idx, _)| idx % stride == 0 || *idx == last);
            Series {
                name: word(split).to_owned(),
                points: kept.map(|(_, point)| point).collect(),
            }
        })
        .collect();
    lines(captions, Scale::Log, &series)
}
