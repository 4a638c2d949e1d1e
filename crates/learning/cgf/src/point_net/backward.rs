//! From the gradient by the features to the gradients by every layer's numbers.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

mod critical;
mod sums;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use self::{
    critical::Top,
    sums::{Place, Running, Sums},
};
use super::{
    EPSILON, Layer, LayerGradient, LayerStack, Normalized, Pass, PointNet, Statistics,
    cloud::{BLOCK, Cloud},
    kernel::{Pairs, by_channels, correlate},
    moments::{Moments, clear_beyond},
};
use crate::{
    precision::{narrow, narrow_all},
    product::{LANES, PackedMatrix, Row, Sparse, project},
};

impl PointNet {
    /// Takes the gradient of a loss by the features to its gradients by every layer's numbers.
    pub(crate) fn backward(&self, pass: Pass, by_features: &[f32]) -> Vec<LayerGradient> {
        let layer_stack = LayerStack {
            normalized: pass.normalized,
            affine: pass.affine,
            ..LayerStack::new(self)
        };
        // Where statistics are stored, only the points that attain a maximum have a gradient.
        let clouds: Vec<Cloud> = match pass.statistics {
            Statistics::Measured => pass.clouds,
            Statistics::Stored => pass
                .clouds
                .into_par_iter()
                .map(|cloud| cloud.critical_alone(&layer_stack))
                .collect(),
        };
        let (top, gradient) = Top::new(&layer_stack, &clouds, pass.moments.last(), by_features);
        let mut gradients = vec![gradient];
        let mut descents: Vec<Descent> = match self.last().checked_sub(1) {
            None => return gradients,
            Some(below) => clouds
                .par_iter()
                .enumerate()
                .map(|(number, cloud)| top.descend(&layer_stack, below, cloud, number))
                .collect(),
        };
        for idx in (0..self.last()).rev() {
            let layer = &self.layers[idx];
            let mut sums = Sums::new(layer, idx);
            for descent in &descents {
                sums.add(&descent.sums);
            }
            let slopes = Slopes::new(layer, &layer_stack.normalized[idx], &sums, &pass.moments);
            if let Some(below) = idx.checked_sub(1) {
                let transposed = PackedMatrix::new(layer.inputs, layer.outputs, |input, output| {
                    layer.weight[output * layer.inputs + input]
                });
                descents = clouds
                    .par_iter()
                    .zip(descents)
                    .map(|(cloud, descent)| {
                        let step = Step {
                            layer_stack: &layer_stack,
                            idx,
                            below,
                            slopes: &slopes,
                            transposed: &transposed,
                        };
                        step.descend(cloud, descent)
                    })
                    .collect();
                let mut by_weight = vec![0.0; layer.weight.len()];
                for descent in &descents {
                    add(&mut by_weight, &descent.by_weight);
                }
                gradients.push(slopes.gradient(&by_weight));
            } else {
                let by_weight = slopes.of_positions(layer, &sums, pass.moments.first());
                gradients.push(slopes.gradient(&by_weight));
            }
        }
        gradients.reverse();
        gradients
    }
}

/// The gradient on its way down one cloud.
struct Descent {
    /// Panel of the gradient by a layer's normalized output, where that is positive; empty for the
    /// first layer, which needs the sums alone.
    by: Vec<Row>,
    sums: Sums,
    /// Gradient by the weight of the layer above.
    by_weight: Vec<f64>,
}

/// `dy = scale g + slope y + constant` for each output of a layer: backward through batch
/// normalization (Ioffe and Szegedy 2015, §3), `gain / sigma (g − mean(g) − y' mean(g y'))`.
struct Slopes {
    by_gain: Vec<f64>,
    by_shift: Vec<f64>,
    /// Scale, slope, constant.
    factors: Vec<[f64; 3]>,
}

impl Slopes {
    fn new(layer: &Layer, normalized: &Normalized, sums: &Sums, moments: &[Moments]) -> Self {
        // The last two terms stand only where the statistics were measured.
        let share = moments.first().map_or(0.0, |moments| 1.0 / moments.n);
        let mut by_gain = Vec::with_capacity(layer.outputs);
        let mut factors = Vec::with_capacity(layer.outputs);
        for c in 0..layer.outputs {
            let (mean, inverse) = (
                normalized.mean[c],
                1.0 / (normalized.variance[c] + EPSILON).sqrt(),
            );
            let by = match sums.gain.get(3 * c..3 * c + 3) {
                Some(by_xyz) if sums.gain.len() == 3 * layer.outputs => {
                    let weight = &layer.weight[3 * c..3 * c + 3];
                    let terms = by_xyz.iter().zip(weight).map(|(by, &w)| by * f64::from(w));
                    terms.sum::<f64>() - mean * sums.shift[c]
                }
                _ => sums.gain[c],
            };
            by_gain.push(by * inverse);
            let scale = f64::from(layer.gain[c]) * inverse;
            let slope = by_gain[c] * share * inverse;
            let constant = sums.shift[c] * share - slope * mean;
            factors.push([scale, -scale * slope, -scale * constant]);
        }
        Self {
            by_gain,
            by_shift: sums.shift.clone(),
            factors,
        }
    }

    /// Takes `g` of a patch to `dy`.
    fn apply(&self, y: &[Row], by: &mut [Row]) {
        Arch::new().dispatch(Apply {
            factors: &self.factors,
            y,
            by,
        });
    }

    /// Gradient by the first layer's weight: `Σ dy xyzᵀ`, where `Σ y xyzᵀ = W Σ xyz xyzᵀ`.
    fn of_positions(&self, layer: &Layer, sums: &Sums, moments: Option<&Moments>) -> Vec<f64> {
        let mut by_weight = Vec::with_capacity(3 * layer.outputs);
        for (c, [scale, slope, constant]) in self.factors.iter().enumerate() {
            for k in 0..3 {
                let mut by = scale * sums.gain[3 * c + k];
                if let Some(moments) = moments {
                    let of_y: f64 = (0..3)
                        .map(|j| {
                            let square = moments.scatter[3 * j + k]
                                + moments.n * moments.mean[j] * moments.mean[k];
                            f64::from(layer.weight[3 * c + j]) * square
                        })
                        .sum();
                    by += slope * of_y + constant * moments.n * moments.mean[k];
                }
                by_weight.push(by);
            }
        }
        by_weight
    }

    fn gradient(&self, by_weight: &[f64]) -> LayerGradient {
        [
            narrow_all(by_weight),
            narrow_all(&self.by_gain),
            narrow_all(&self.by_shift),
        ]
    }
}

struct Apply<'a> {
    factors: &'a [[f64; 3]],
    y: &'a [Row],
    by: &'a mut [Row],
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for ((by, y), factors) in self.by.iter_mut().zip(self.y).zip(self.factors) {
            let [scale, slope, constant] = factors.map(|factor| simd.splat_f32s(narrow(factor)));
            let (by, y) = (S::as_mut_simd_f32s(by).0, S::as_simd_f32s(y).0);
            for (by, &y) in by.iter_mut().zip(y) {
                *by = simd.mul_add_f32s(scale, *by, simd.mul_add_f32s(slope, y, constant));
            }
        }
    }
}

/// From the output of layer `idx` to that of the layer below it.
struct Step<'a> {
    layer_stack: &'a LayerStack<'a>,
    idx: usize,
    below: usize,
    slopes: &'a Slopes,
    /// Matrix of the layer, turned over.
    transposed: &'a PackedMatrix,
}

impl Step<'_> {
    fn descend(&self, cloud: &Cloud, from: Descent) -> Descent {
        let layer = &self.layer_stack.layers[self.idx];
        let (inputs, outputs) = (layer.inputs, layer.outputs);
        let mut by = from.by;
        let below = &self.layer_stack.layers[self.below];
        let mut running = Running::new(below, self.below);
        let kept = if self.below > 0 {
            cloud.patches() * inputs
        } else {
            0
        };
        let mut down = Vec::with_capacity(kept);
        let mut by_weight = vec![0.0; outputs * inputs];
        let (mut sparse, mut xs) = (Sparse::default(), Vec::new());
        let mut channels = [Vec::new(), Vec::new()];
        let mut g = vec![[0.0; LANES]; inputs];
        let zeros = vec![0.0; inputs];
        let mut products = vec![0.0; outputs * inputs];
        for (block, by) in by.chunks_mut(BLOCK * outputs).enumerate() {
            let n = by.len() / outputs;
            xs.resize(n * inputs, [0.0; LANES]);
            let patches = block * BLOCK..;
            for ((patch, by), x) in patches
                .zip(by.chunks_exact_mut(outputs))
                .zip(xs.chunks_exact_mut(inputs))
            {
                self.slopes.apply(cloud.linear(layer, self.idx, patch), by);
                clear_beyond(by, cloud.points_of(patch));
                cloud.input(self.layer_stack, self.idx, patch, x);
                sparse.take(by);
                let alone = std::slice::from_ref(&sparse);
                project(self.transposed, alone, &zeros, &mut g);
                let place = Place::new(self.layer_stack, self.below, cloud, patch);
                running.absorb(&place, x, &mut g);
                if self.below > 0 {
                    down.extend_from_slice(&g);
                }
            }
            let [by_channel, x_channel] = &mut channels;
            by_channels(by, outputs, by_channel);
            by_channels(&xs, inputs, x_channel);
            correlate(by_channel, x_channel, n, Pairs::All, &mut products);
            for (sum, &product) in by_weight.iter_mut().zip(&products) {
                *sum += f64::from(product);
            }
        }
        Descent {
            by: down,
            sums: running.finish(),
            by_weight,
        }
    }
}

fn add(sums: &mut [f64], terms: &[f64]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}
