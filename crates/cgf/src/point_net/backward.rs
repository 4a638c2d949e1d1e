//! From the gradient by the features to the gradients by every layer's numbers.

use rayon::prelude::*;

use super::{
    EPSILON, LayerGradient, Pass, PointNet, Statistics,
    rows::{Transposed, cloud_sums, product},
};
use crate::{
    CgfError,
    precision::{narrow, narrow_all},
};

impl PointNet {
    /// Takes the gradient of a loss by the features to its gradients by every layer's numbers.
    pub(crate) fn backward(
        &self,
        pass: &Pass,
        by_features: &[f32],
    ) -> Result<Vec<LayerGradient>, CgfError> {
        let rows = pass.n_clouds * pass.points;
        let (last_gradient, mut by_above) = self.backward_last(pass, by_features)?;
        let mut gradients = vec![last_gradient];
        for (idx, layer) in self.layers[..self.layers.len() - 1]
            .iter()
            .enumerate()
            .rev()
        {
            let normalized = &pass.normalized[idx];
            let (linear, above) = (&pass.linear[idx], &pass.inputs[idx + 1]);
            let outputs = layer.outputs;
            // Through max(x, 0).
            by_above
                .par_iter_mut()
                .zip(above.par_iter())
                .with_min_len(4096)
                .for_each(|(by, &x)| {
                    if x <= 0.0 {
                        *by = 0.0;
                    }
                });
            // y' = (y − mean) / sigma; by_shift = Σ dy', by_gain = Σ dy' y'.
            let inverse: Vec<f64> = normalized
                .variance
                .iter()
                .map(|v| 1.0 / (v + EPSILON).sqrt())
                .collect();
            let sums = cloud_sums(
                linear.len() / (pass.points * outputs),
                2 * outputs,
                |cloud, sums| {
                    let block = cloud * pass.points * outputs..(cloud + 1) * pass.points * outputs;
                    let (shift, gain) = sums.split_at_mut(outputs);
                    for (by, y) in by_above[block.clone()]
                        .chunks_exact(outputs)
                        .zip(linear[block].chunks_exact(outputs))
                    {
                        let sums = shift.iter_mut().zip(gain.iter_mut());
                        let terms = by.iter().zip(y).zip(&normalized.mean);
                        for ((shift, gain), ((&by, &y), mean)) in sums.zip(terms) {
                            *shift += f64::from(by);
                            *gain += f64::from(by) * (f64::from(y) - mean);
                        }
                    }
                },
            );
            let by_shift = &sums[..outputs];
            let by_gain: Vec<f64> = sums[outputs..]
                .iter()
                .zip(&inverse)
                .map(|(s, i)| s * i)
                .collect();
            // dy = gain / sigma (dy' − mean(dy') − y' mean(dy' y')), the last two only if measured.
            let share = match pass.statistics {
                Statistics::Measured => 1.0 / rows as f64,
                Statistics::Stored => 0.0,
            };
            let factors: Vec<[f32; 3]> = (0..outputs)
                .map(|c| {
                    let scale = f64::from(layer.gain[c]) * inverse[c];
                    let slope = by_gain[c] * share * inverse[c];
                    let constant = by_shift[c] * share - slope * normalized.mean[c];
                    [scale, -scale * slope, -scale * constant].map(narrow)
                })
                .collect();
            by_above
                .par_chunks_mut(pass.points * outputs)
                .zip(linear.par_chunks(pass.points * outputs))
                .for_each(|(by, linear)| {
                    for (by, linear) in by
                        .chunks_exact_mut(outputs)
                        .zip(linear.chunks_exact(outputs))
                    {
                        for ((by, &y), &[scale, slope, constant]) in
                            by.iter_mut().zip(linear).zip(&factors)
                        {
                            *by = scale * *by + slope * y + constant;
                        }
                    }
                });
            let below = &pass.inputs[idx];
            let by_weight = product(
                &by_above,
                [rows, outputs],
                below,
                [rows, layer.inputs],
                Transposed::Left,
            )?;
            if idx > 0 {
                by_above = product(
                    &by_above,
                    [rows, outputs],
                    &layer.weight,
                    [outputs, layer.inputs],
                    Transposed::Neither,
                )?;
            }
            gradients.push([by_weight, narrow_all(&by_gain), narrow_all(by_shift)]);
        }
        gradients.reverse();
        Ok(gradients)
    }

    /// Backward through the maximum: a sparse part at the critical points, and, where the statistics
    /// were measured, a part of rank `inputs` at all points.
    #[expect(
        clippy::too_many_lines,
        reason = "one derivation, in the order in which it is written on paper"
    )]
    fn backward_last(
        &self,
        pass: &Pass,
        by_features: &[f32],
    ) -> Result<(LayerGradient, Vec<f32>), CgfError> {
        let idx = self.layers.len() - 1;
        let layer = &self.layers[idx];
        let (points, inputs, outputs) = (pass.points, layer.inputs, layer.outputs);
        let normalized = &pass.normalized[idx];
        let below = &pass.inputs[idx];
        let rows = pass.n_clouds * points;
        let inverse: Vec<f64> = normalized
            .variance
            .iter()
            .map(|v| 1.0 / (v + EPSILON).sqrt())
            .collect();
        let scale: Vec<f64> = inverse
            .iter()
            .zip(&layer.gain)
            .map(|(i, &g)| i * f64::from(g))
            .collect();
        let (mut by_gain, mut by_shift) = (vec![0.0; outputs], vec![0.0; outputs]);
        for (by, attained) in by_features
            .chunks_exact(outputs)
            .zip(pass.attained.chunks_exact(outputs))
        {
            for c in 0..outputs {
                by_shift[c] += f64::from(by[c]);
                by_gain[c] +=
                    f64::from(by[c]) * (f64::from(attained[c]) - normalized.mean[c]) * inverse[c];
            }
        }
        let mut by_weight = vec![0.0; outputs * inputs];
        by_weight
            .par_chunks_mut(inputs)
            .enumerate()
            .for_each(|(c, row)| {
                for cloud in 0..pass.n_clouds {
                    let by = by_features[cloud * outputs + c] * narrow(scale[c]);
                    let at = pass.critical[cloud * outputs + c] * inputs;
                    for (w, &x) in row.iter_mut().zip(&below[at..at + inputs]) {
                        *w += by * x;
                    }
                }
            });
        let mut by_below = vec![0.0; rows * inputs];
        if pass.statistics == Statistics::Measured {
            // dy = scale (dy' − A − y' B) with A = by_shift / rows, B = by_gain / rows: sum over channels.
            let mut constant = vec![0.0; inputs];
            let mut weighted = vec![0.0_f32; outputs * inputs];
            for c in 0..outputs {
                let a = scale[c] * by_shift[c] / rows as f64;
                let b = scale[c] * inverse[c] * by_gain[c] / rows as f64;
                let w = &layer.weight[c * inputs..(c + 1) * inputs];
                for k in 0..inputs {
                    constant[k] += a * f64::from(w[k]);
                    weighted[c * inputs + k] = narrow(b * f64::from(w[k]));
                }
            }
            let kernel = product(
                &weighted,
                [outputs, inputs],
                &layer.weight,
                [outputs, inputs],
                Transposed::Left,
            )?;
            let spread = product(
                below,
                [rows, inputs],
                &kernel,
                [inputs, inputs],
                Transposed::Neither,
            )?;
            // The product was taken with the points as they are, not less their mean.
            let shifted: Vec<f32> = (0..inputs)
                .map(|k| {
                    let at_mean: f64 = (0..inputs)
                        .map(|j| pass.below_mean[j] * f64::from(kernel[j * inputs + k]))
                        .sum();
                    narrow(constant[k] - at_mean)
                })
                .collect();
            by_below
                .par_chunks_mut(points * inputs)
                .zip(spread.par_chunks(points * inputs))
                .for_each(|(by, spread)| {
                    for (by, spread) in by.chunks_exact_mut(inputs).zip(spread.chunks_exact(inputs))
                    {
                        for ((by, &spread), &shifted) in by.iter_mut().zip(spread).zip(&shifted) {
                            *by = -spread - shifted;
                        }
                    }
                });
            // dw = … − A scale Σ x − B scale Σ y' x, and Σ y' x = rows / sigma · w' Cov.
            let by_covariance = product(
                &weighted,
                [outputs, inputs],
                &pass.below_covariance,
                [inputs, inputs],
                Transposed::Neither,
            )?;
            for c in 0..outputs {
                let a = scale[c] * by_shift[c];
                for k in 0..inputs {
                    let dense = a * pass.below_mean[k]
                        + rows as f64 * f64::from(by_covariance[c * inputs + k]);
                    by_weight[c * inputs + k] -= narrow(dense);
                }
            }
        }
        by_below
            .par_chunks_mut(points * inputs)
            .enumerate()
            .for_each(|(cloud, by_below)| {
                for c in 0..outputs {
                    let by = by_features[cloud * outputs + c] * narrow(scale[c]);
                    let at = (pass.critical[cloud * outputs + c] - cloud * points) * inputs;
                    let w = &layer.weight[c * inputs..(c + 1) * inputs];
                    for (x, &w) in by_below[at..at + inputs].iter_mut().zip(w) {
                        *x += by * w;
                    }
                }
            });
        Ok((
            [by_weight, narrow_all(&by_gain), narrow_all(&by_shift)],
            by_below,
        ))
    }
}
