//! Histograms of values.

use crate::{
    axis::{Axis, AxisRange, Scale},
    canvas::Stroke,
    captions::Captions,
    figure::{Figure, Mark, Side},
    style::{DATA_HEIGHT, color},
};

/// Values of one kind. Values that are not finite are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Its name in the legend.
    pub name: String,
    /// The values, in any order.
    pub values: Vec<f64>,
}

/// Draws how many values of each sample fall into each of `n_bins` equal ranges of the axis, as shares
/// of the sample in percent, so that samples of different sizes compare. `captions.y` is usually `share [%]`.
/// `None` if no value is finite or there are no ranges.
pub fn histogram(captions: &Captions, n_bins: usize, samples: &[Sample]) -> Option<String> {
    let all = samples
        .iter()
        .flat_map(|sample| sample.values.iter().copied());
    let x = Axis::new(Scale::Linear, AxisRange::Round, 6, all).filter(|_| n_bins > 0)?;
    let shares: Vec<Vec<f64>> = samples
        .iter()
        .map(|sample| shares(&x, n_bins, &sample.values))
        .collect();
    let highest = shares.iter().flatten().copied();
    let y = Axis::new(Scale::Linear, AxisRange::Zero, 5, highest)?;
    let names: Vec<&str> = samples.iter().map(|sample| sample.name.as_str()).collect();
    let around = (&x, &Side::Axis(&y));
    let mut figure = Figure::new(captions, DATA_HEIGHT, around, (&names, Mark::Area));
    let edge = |idx: usize| idx as f64 / n_bins as f64;
    for (idx, shares) in shares.iter().enumerate() {
        let mut outline = vec![figure.at([0.0, 0.0])];
        for (bin, share) in shares.iter().enumerate() {
            let height = y.place(*share).unwrap_or_default();
            let corners = [
                figure.at([edge(bin), 0.0]),
                figure.at([edge(bin + 1), height]),
            ];
            if *share > 0.0 {
                figure.canvas.rectangle(corners, color(idx), 0.25);
            }
            outline.push(figure.at([edge(bin), height]));
            outline.push(figure.at([edge(bin + 1), height]));
        }
        outline.push(figure.at([1.0, 0.0]));
        figure.canvas.path(&outline, Stroke::solid(color(idx), 1.5));
    }
    Some(figure.canvas.finish())
}

/// The share of the values in each bin of an axis, in percent of those that have a place.
fn shares(axis: &Axis, n_bins: usize, values: &[f64]) -> Vec<f64> {
    let mut counts = vec![0_usize; n_bins];
    let mut n_placed = 0_usize;
    for place in values.iter().filter_map(|value| axis.place(*value)) {
        // The last edge belongs to the last bin.
        let bin = bin_of(place, n_bins);
        if let Some(count) = counts.get_mut(bin) {
            *count += 1;
            n_placed += 1;
        }
    }
    let whole = n_placed.max(1) as f64;
    counts
        .iter()
        .map(|count| *count as f64 / whole * 100.0)
        .collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a place on an axis lies in 0..=1"
)]
fn bin_of(place: f64, n_bins: usize) -> usize {
    ((place.clamp(0.0, 1.0) * n_bins as f64) as usize).min(n_bins.saturating_sub(1))
}
