//! Learning curves of the training.

use charts::{Captions, Scale, Series, lines};
use schemas::training::{EpochLosses, Split};

use crate::{
    PageData,
    table::{Cell, DataTable, Section},
};

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
    let splits = [Split::Training, Split::HeldOut, Split::Unseen];
    let of = |split: Split| {
        gathered
            .training
            .iter()
            .filter(move |row| row.split == split)
    };
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
    for split in splits {
        let Some(end) = of(split).next_back() else {
            continue;
        };
        let least = of(split).min_by(|a, b| a.total.total_cmp(&b.total));
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
    section.tables.push(table);
    let curve = |name: &'static str, unit: &'static str, number: fn(&EpochLosses) -> f64| {
        let series: Vec<Series> = splits
            .into_iter()
            .filter(|split| of(*split).next().is_some())
            .map(|split| {
                let points: Vec<[f64; 2]> = of(split)
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
        let captions = Captions {
            title: name,
            x: "epoch",
            y: unit,
        };
        lines(&captions, Scale::Log, &series)
    };
    section.chart(
        "Weighted sum of the losses by epoch",
        curve("Total loss", "loss", |row| row.total),
    );
    section.chart(
        "Divergence of the latent codes by epoch",
        curve("Divergence of latent codes", "divergence [nat]", |row| {
            row.kl_nats
        }),
    );
    section
}
