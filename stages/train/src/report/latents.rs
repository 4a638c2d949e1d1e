//! Use of the latent code.

use cgf::{Description, EncodedDemonstration};
use charts::{Captions, Scale, Series, lines, scatter};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Scope, Sum,
    Summary, Unit,
};
use lake::{LakeError, WriteArtifact};
use schemas::{
    Table,
    latents::{LatentDimension, Latents},
    training::Split,
};

use super::{description, mean, of_description, shown_split};
use crate::{Train, TrainConfig};

/// Variance of the means beyond which a dimension is active (Burda, Grosse and Salakhutdinov,
/// *Importance Weighted Autoencoders*, 2016, section 5.2).
const ACTIVE: f64 = 0.01;

dataflow::metrics! {
    /// Metrics of a function's latent code.
    pub struct LatentMetrics {
        /// Number of its dimensions.
        latents_n: Sum,
        /// Number of those in use.
        active_n: Sum,
        /// Divergence of all dimensions together, in nats.
        kl_nats: Mean,
    }
}

/// The report `latents`: what is used of the latent code.
pub struct LatentsReport;

impl Output for LatentsReport {
    type Stage = Train;
    type Metrics = LatentMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Latents::NAME;
    const SCHEMA: &'static str = Latents::VERSION;
    const PARTITION: &'static str = Latents::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<LatentMetrics>> = Some(line);

    fn units(config: &TrainConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        of_description(config, scope)
    }

    /// Makes the table of dimensions and its charts.
    fn make(
        _config: &TrainConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<LatentMetrics>, BoxedDiagnostic> {
        let description = description(inputs)?;
        let rows = rows(&description);
        cx.write(&rows)?;
        draw(&description, &rows, cx)?;
        let metrics = LatentMetrics {
            latents_n: rows.len() as f64,
            active_n: rows.iter().filter(|row| row.active).count() as f64,
            kl_nats: rows.iter().map(|row| row.kl_nats).sum(),
        };
        Ok(Outcome::Made(metrics))
    }
}

fn line(summary: &Summary<LatentMetrics>) -> String {
    let all = &summary.metrics;
    format!(
        "{} of {} active latent dimensions, KL {:.1} nats",
        all.active_n, all.latents_n, all.kl_nats,
    )
}

fn rows(description: &Description) -> Vec<LatentDimension> {
    (0..description.network.latent_dim)
        .map(|dimension| {
            let codes = || {
                let learned = description.of_split(Split::Training);
                learned.filter_map(move |demonstration| code(demonstration, dimension))
            };
            let center = mean(codes().map(|(mean, _)| mean));
            let variance = mean(codes().map(|(mean, _)| (mean - center).powi(2)));
            LatentDimension {
                dimension: i64::try_from(dimension).unwrap_or(i64::MAX),
                // Kingma and Welling, *Auto-Encoding Variational Bayes*, 2014, appendix B.
                kl_nats: mean(codes().map(|(mean, deviation)| {
                    0.5 * (mean.powi(2) + deviation.powi(2) - 1.0) - deviation.ln()
                })),
                mean_deviation: variance.sqrt(),
                deviation_mean: mean(codes().map(|(_, deviation)| deviation)),
                active: variance > ACTIVE,
            }
        })
        .collect()
}

/// Mean and standard deviation of a motion's code in one dimension.
fn code(demonstration: &EncodedDemonstration, dimension: usize) -> Option<(f64, f64)> {
    let mean = demonstration.latent_mean.get(dimension)?;
    let deviation = demonstration.latent_deviation.get(dimension)?;
    Some((*mean, *deviation))
}

fn draw(
    description: &Description,
    rows: &[LatentDimension],
    cx: &Context,
) -> Result<(), LakeError> {
    let mut ranked: Vec<(usize, &LatentDimension)> = rows.iter().enumerate().collect();
    ranked.sort_by(|(_, a), (_, b)| b.kl_nats.total_cmp(&a.kl_nats));
    let by_rank = |name: &str, number: fn(&LatentDimension) -> f64| Series {
        name: name.to_owned(),
        points: (1_u32..)
            .zip(&ranked)
            .map(|(rank, (_, row))| [rank.into(), number(row)])
            .collect(),
    };
    let captions = |title, y| Captions {
        title,
        x: "dimensions of the latent code, the most used first",
        y,
    };
    let used = lines(
        &captions("Use of the latent code", "KL [nats]"),
        Scale::Linear,
        &[by_rank("divergence", |row| row.kl_nats)],
    );
    cx.write_chart("kl", used)?;
    let deviations = lines(
        &captions("Spread of the latent codes", "standard deviation"),
        Scale::Linear,
        &[
            by_rank("of the motions' means", |row| row.mean_deviation),
            by_rank("of one motion, mean", |row| row.deviation_mean),
        ],
    );
    cx.write_chart("spread", deviations)?;
    let [(first, _), (second, _), ..] = ranked[..] else {
        return Ok(());
    };
    let x = format!("dimension {first}");
    let y = format!("dimension {second}");
    let captions = Captions {
        title: "Means of the motions' codes in the two dimensions most used",
        x: &x,
        y: &y,
    };
    let sets = Split::ALL.map(|split| Series {
        name: shown_split(split),
        points: description
            .of_split(split)
            .filter_map(|motion| Some([code(motion, first)?.0, code(motion, second)?.0]))
            .collect(),
    });
    let sets: Vec<Series> = sets
        .into_iter()
        .filter(|set| !set.points.is_empty())
        .collect();
    cx.write_chart("means", scatter(&captions, &sets))
}
