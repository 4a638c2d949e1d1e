//! The object feature: a network over surface points (Qi et al., *PointNet*, 2017, §4.2 without its
//! transforms), computed exactly but without the tensors that make it slow.
//!
//! Every layer is a matrix per point and batch normalization (Ioffe and Szegedy 2015, algorithm 1);
//! all but the last end in `max(x, 0)`, and the last in the maximum over the points of a cloud.
//! Only the points that attain a maximum matter to the last layer, and its statistics over all points
//! follow from the mean and the covariance of the layer below, because it is linear. Its
//! `(clouds × points, width)` tensor is therefore made one cloud at a time and never kept.
//! Forward and backward are written by hand; `f64` carries every sum over points.

use candle_core::{Device, Tensor};
use rayon::prelude::*;

use crate::{
    CgfError,
    precision::{narrow, narrow_all},
    random::Random,
    weights::Weights,
};

/// Added to variances before their root is taken.
const EPSILON: f64 = 1e-5;

/// Which means and variances normalize the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Statistics {
    /// Those of the points at hand.
    Measured,
    /// Those stored with the weights.
    Stored,
}

/// Clouds of equally many points.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clouds {
    /// Number of points of each cloud.
    pub(crate) points: usize,
    /// Cloud after cloud, point after point, `xyz`, in meters.
    pub(crate) xyz: Vec<f32>,
}

/// One layer's numbers.
#[derive(Debug, Clone)]
struct Layer {
    inputs: usize,
    outputs: usize,
    /// `(outputs, inputs)`.
    weight: Vec<f32>,
    gain: Vec<f32>,
    shift: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

/// The point network.
#[derive(Debug, Clone)]
pub(crate) struct PointNet {
    layers: Vec<Layer>,
}

/// What one layer normalized with.
#[derive(Debug, Clone)]
struct Normalized {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

/// What a forward pass leaves for the backward pass.
pub(crate) struct Pass {
    statistics: Statistics,
    n_clouds: usize,
    points: usize,
    /// Input of each layer, `(clouds × points, inputs)`.
    inputs: Vec<Vec<f32>>,
    /// Output of each layer but the last before normalization.
    linear: Vec<Vec<f32>>,
    normalized: Vec<Normalized>,
    /// Row of the point that attains each maximum, `(clouds, width)`.
    critical: Vec<usize>,
    /// The last layer's output before normalization at that point.
    attained: Vec<f32>,
    /// Mean and covariance of the last layer's input over all points.
    below_mean: Vec<f64>,
    below_covariance: Vec<f32>,
    /// The object features, `(clouds, width)`.
    pub(crate) features: Vec<f32>,
}

/// The gradients of one layer's weight, gain and shift.
pub(crate) type LayerGradient = [Vec<f32>; 3];

/// Names of a layer's arrays, in the order of [`LayerGradient`].
pub(crate) fn names(layer: usize) -> [String; 3] {
    ["weight", "gain", "shift"].map(|name| format!("point_net.{layer}.{name}"))
}

/// Adds a point network at random.
pub(crate) fn initialize(weights: &mut Weights, widths: &[usize], random: &mut Random) {
    let mut inputs = 3;
    for (layer, &outputs) in widths.iter().enumerate() {
        weights.set_random(&format!("point_net.{layer}.weight"), outputs, inputs, random);
        for (name, value) in [("gain", 1.0), ("shift", 0.0), ("mean", 0.0), ("variance", 1.0)] {
            weights.set_constant(&format!("point_net.{layer}.{name}"), outputs, value);
        }
        inputs = outputs;
    }
}

impl PointNet {
    pub(crate) fn new(weights: &Weights, n_layers: usize) -> Result<Self, CgfError> {
        let layers = (0..n_layers)
            .map(|layer| {
                let values = |name: &str| {
                    Ok::<_, CgfError>(weights.array(&format!("point_net.{layer}.{name}"))?.values.clone())
                };
                let (weight, gain) = (values("weight")?, values("gain")?);
                Ok(Layer {
                    inputs: weight.len() / gain.len().max(1),
                    outputs: gain.len(),
                    weight,
                    gain,
                    shift: values("shift")?,
                    mean: values("mean")?,
                    variance: values("variance")?,
                })
            })
            .collect::<Result<_, CgfError>>()?;
        Ok(Self { layers })
    }

    /// Computes the feature of every cloud.
    pub(crate) fn forward(&self, clouds: &Clouds, statistics: Statistics) -> Result<Pass, CgfError> {
        let points = clouds.points;
        let mut pass = Pass {
            statistics,
            n_clouds: clouds.xyz.len() / (3 * points),
            points,
            inputs: vec![clouds.xyz.clone()],
            linear: Vec::new(),
            normalized: Vec::new(),
            critical: Vec::new(),
            attained: Vec::new(),
            below_mean: Vec::new(),
            below_covariance: Vec::new(),
            features: Vec::new(),
        };
        let last = self.layers.len() - 1;
        for layer in &self.layers[..last] {
            let below = &pass.inputs[pass.inputs.len() - 1];
            let rows = pass.n_clouds * points;
            let linear = product(below, [rows, layer.inputs], &layer.weight, [layer.outputs, layer.inputs], Transposed::Right)?;
            let normalized = match statistics {
                Statistics::Measured => measure(&linear, layer.outputs, points),
                Statistics::Stored => layer.stored(),
            };
            let (scale, offset) = layer.affine(&normalized);
            let mut above = vec![0.0; linear.len()];
            above
                .par_chunks_mut(points * layer.outputs)
                .zip(linear.par_chunks(points * layer.outputs))
                .for_each(|(above, linear)| {
                    for (above, linear) in above.chunks_exact_mut(layer.outputs).zip(linear.chunks_exact(layer.outputs)) {
                        for (((above, &y), &scale), &offset) in above.iter_mut().zip(linear).zip(&scale).zip(&offset) {
                            *above = (scale * y + offset).max(0.0);
                        }
                    }
                });
            pass.linear.push(linear);
            pass.normalized.push(normalized);
            pass.inputs.push(above);
        }
        self.forward_last(&mut pass)?;
        Ok(pass)
    }

    /// The last layer: search the largest point of each cloud and channel, then normalize that one.
    fn forward_last(&self, pass: &mut Pass) -> Result<(), CgfError> {
        let layer = &self.layers[self.layers.len() - 1];
        let (points, inputs, outputs) = (pass.points, layer.inputs, layer.outputs);
        let below = &pass.inputs[pass.inputs.len() - 1];
        let normalized = match pass.statistics {
            Statistics::Measured => {
                let mean = column_means(below, inputs, points);
                let covariance = covariance(below, &mean, points)?;
                let normalized = layer.normalized_from(&mean, &covariance);
                pass.below_mean = mean;
                pass.below_covariance = covariance;
                normalized
            }
            Statistics::Stored => layer.stored(),
        };
        // A negative gain turns the largest into the smallest.
        let signed: Vec<f32> = layer
            .weight
            .chunks_exact(inputs)
            .zip(&layer.gain)
            .flat_map(|(row, &gain)| row.iter().map(move |&w| if gain < 0.0 { -w } else { w }))
            .collect();
        let (scale, offset) = layer.affine(&normalized);
        for (cloud, rows) in below.chunks_exact(points * inputs).enumerate() {
            let values = product(rows, [points, inputs], &signed, [outputs, inputs], Transposed::Right)?;
            let mut largest = vec![f32::NEG_INFINITY; outputs];
            let mut at = vec![0_u32; outputs];
            for (point, values) in (0_u32..).zip(values.chunks_exact(outputs)) {
                for ((largest, at), &value) in largest.iter_mut().zip(&mut at).zip(values) {
                    let larger = value > *largest;
                    *largest = if larger { value } else { *largest };
                    *at = if larger { point } else { *at };
                }
            }
            for (c, (&value, &at)) in largest.iter().zip(&at).enumerate() {
                let value = if layer.gain[c] < 0.0 { -value } else { value };
                pass.critical.push(cloud * points + at as usize);
                pass.attained.push(value);
                pass.features.push(scale[c] * value + offset[c]);
            }
        }
        pass.normalized.push(normalized);
        Ok(())
    }

    /// Takes the gradient of a loss by the features to its gradients by every layer's numbers.
    pub(crate) fn backward(&self, pass: &Pass, by_features: &[f32]) -> Result<Vec<LayerGradient>, CgfError> {
        let rows = pass.n_clouds * pass.points;
        let (last_gradient, mut by_above) = self.backward_last(pass, by_features)?;
        let mut gradients = vec![last_gradient];
        for (idx, layer) in self.layers[..self.layers.len() - 1].iter().enumerate().rev() {
            let normalized = &pass.normalized[idx];
            let (linear, above) = (&pass.linear[idx], &pass.inputs[idx + 1]);
            let outputs = layer.outputs;
            // Through max(x, 0).
            by_above.par_iter_mut().zip(above.par_iter()).with_min_len(4096).for_each(|(by, &x)| {
                if x <= 0.0 {
                    *by = 0.0;
                }
            });
            // y' = (y − mean) / sigma; by_shift = Σ dy', by_gain = Σ dy' y'.
            let inverse: Vec<f64> = normalized.variance.iter().map(|v| 1.0 / (v + EPSILON).sqrt()).collect();
            let sums = cloud_sums(linear.len() / (pass.points * outputs), 2 * outputs, |cloud, sums| {
                let block = cloud * pass.points * outputs..(cloud + 1) * pass.points * outputs;
                let (shift, gain) = sums.split_at_mut(outputs);
                for (by, y) in by_above[block.clone()].chunks_exact(outputs).zip(linear[block].chunks_exact(outputs)) {
                    for c in 0..outputs {
                        shift[c] += f64::from(by[c]);
                        gain[c] += f64::from(by[c]) * (f64::from(y[c]) - normalized.mean[c]);
                    }
                }
            });
            let by_shift = &sums[..outputs];
            let by_gain: Vec<f64> = sums[outputs..].iter().zip(&inverse).map(|(s, i)| s * i).collect();
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
                    for (by, linear) in by.chunks_exact_mut(outputs).zip(linear.chunks_exact(outputs)) {
                        for ((by, &y), &[scale, slope, constant]) in by.iter_mut().zip(linear).zip(&factors) {
                            *by = scale * *by + slope * y + constant;
                        }
                    }
                });
            let below = &pass.inputs[idx];
            let by_weight = product(&by_above, [rows, outputs], below, [rows, layer.inputs], Transposed::Left)?;
            if idx > 0 {
                by_above = product(&by_above, [rows, outputs], &layer.weight, [outputs, layer.inputs], Transposed::Neither)?;
            }
            gradients.push([by_weight, narrow_all(&by_gain), narrow_all(by_shift)]);
        }
        gradients.reverse();
        Ok(gradients)
    }

    /// Backward through the maximum: a sparse part at the critical points, and, where the statistics
    /// were measured, a part of rank `inputs` at all points.
    fn backward_last(&self, pass: &Pass, by_features: &[f32]) -> Result<(LayerGradient, Vec<f32>), CgfError> {
        let idx = self.layers.len() - 1;
        let layer = &self.layers[idx];
        let (points, inputs, outputs) = (pass.points, layer.inputs, layer.outputs);
        let normalized = &pass.normalized[idx];
        let below = &pass.inputs[idx];
        let rows = pass.n_clouds * points;
        let inverse: Vec<f64> = normalized.variance.iter().map(|v| 1.0 / (v + EPSILON).sqrt()).collect();
        let scale: Vec<f64> = inverse.iter().zip(&layer.gain).map(|(i, &g)| i * f64::from(g)).collect();
        let (mut by_gain, mut by_shift) = (vec![0.0; outputs], vec![0.0; outputs]);
        for (by, attained) in by_features.chunks_exact(outputs).zip(pass.attained.chunks_exact(outputs)) {
            for c in 0..outputs {
                by_shift[c] += f64::from(by[c]);
                by_gain[c] += f64::from(by[c]) * (f64::from(attained[c]) - normalized.mean[c]) * inverse[c];
            }
        }
        let mut by_weight = vec![0.0; outputs * inputs];
        by_weight.par_chunks_mut(inputs).enumerate().for_each(|(c, row)| {
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
            let kernel = product(&weighted, [outputs, inputs], &layer.weight, [outputs, inputs], Transposed::Left)?;
            let spread = product(below, [rows, inputs], &kernel, [inputs, inputs], Transposed::Neither)?;
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
                    for (by, spread) in by.chunks_exact_mut(inputs).zip(spread.chunks_exact(inputs)) {
                        for ((by, &spread), &shifted) in by.iter_mut().zip(spread).zip(&shifted) {
                            *by = -spread - shifted;
                        }
                    }
                });
            // dw = … − A scale Σ x − B scale Σ y' x, and Σ y' x = rows / sigma · w' Cov.
            let by_covariance = product(&weighted, [outputs, inputs], &pass.below_covariance, [inputs, inputs], Transposed::Neither)?;
            for c in 0..outputs {
                let a = scale[c] * by_shift[c];
                for k in 0..inputs {
                    let dense = a * pass.below_mean[k] + rows as f64 * f64::from(by_covariance[c * inputs + k]);
                    by_weight[c * inputs + k] -= narrow(dense);
                }
            }
        }
        by_below.par_chunks_mut(points * inputs).enumerate().for_each(|(cloud, by_below)| {
            for c in 0..outputs {
                let by = by_features[cloud * outputs + c] * narrow(scale[c]);
                let at = (pass.critical[cloud * outputs + c] - cloud * points) * inputs;
                let w = &layer.weight[c * inputs..(c + 1) * inputs];
                for (x, &w) in by_below[at..at + inputs].iter_mut().zip(w) {
                    *x += by * w;
                }
            }
        });
        Ok(([by_weight, narrow_all(&by_gain), narrow_all(&by_shift)], by_below))
    }

    /// Moves the stored statistics a share of the way to those measured in a pass.
    pub(crate) fn store(pass: &Pass, momentum: f32, weights: &mut Weights) -> Result<(), CgfError> {
        let rows = (pass.n_clouds * pass.points) as f64;
        for (layer, normalized) in pass.normalized.iter().enumerate() {
            // The stored variance is unbiased, the one normalized with is not.
            let variance: Vec<f64> = normalized.variance.iter().map(|v| v * rows / (rows - 1.0)).collect();
            for (name, measured) in [("mean", &normalized.mean), ("variance", &variance)] {
                let name = format!("point_net.{layer}.{name}");
                let stored = &weights.array(&name)?.values;
                let moved = stored
                    .iter()
                    .zip(measured)
                    .map(|(&stored, &measured)| stored + momentum * (narrow(measured) - stored))
                    .collect::<Vec<f32>>();
                weights.set(&name, &[moved.len()], moved);
            }
        }
        Ok(())
    }
}

impl Layer {
    fn stored(&self) -> Normalized {
        let widen = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect();
        Normalized {
            mean: widen(&self.mean),
            variance: widen(&self.variance),
        }
    }

    /// Returns scale and offset of `gain (y − mean) / sigma + shift`.
    fn affine(&self, normalized: &Normalized) -> (Vec<f32>, Vec<f32>) {
        (0..self.outputs)
            .map(|c| {
                let scale = f64::from(self.gain[c]) / (normalized.variance[c] + EPSILON).sqrt();
                let offset = f64::from(self.shift[c]) - scale * normalized.mean[c];
                (narrow(scale), narrow(offset))
            })
            .unzip()
    }

    /// Returns mean `w · mean` and variance `w · Cov w` of every output.
    fn normalized_from(&self, mean: &[f64], covariance: &[f32]) -> Normalized {
        let n = self.inputs;
        let (mean, variance) = self
            .weight
            .par_chunks(n)
            .map(|w| {
                let w: Vec<f64> = w.iter().map(|&x| f64::from(x)).collect();
                let dot = |row: &[f32]| -> f64 { row.iter().zip(&w).map(|(&x, w)| f64::from(x) * w).sum() };
                let variance: f64 = covariance.chunks_exact(n).zip(&w).map(|(row, w)| w * dot(row)).sum();
                let mean: f64 = mean.iter().zip(&w).map(|(m, w)| m * w).sum();
                (mean, variance.max(0.0))
            })
            .unzip();
        Normalized { mean, variance }
    }
}

/// Which factor of a product is turned over.
#[derive(Debug, Clone, Copy)]
enum Transposed {
    Neither,
    Left,
    Right,
}

/// Multiplies two matrices given as rows.
fn product(left: &[f32], left_shape: [usize; 2], right: &[f32], right_shape: [usize; 2], transposed: Transposed) -> Result<Vec<f32>, CgfError> {
    let left = Tensor::from_slice(left, &left_shape[..], &Device::Cpu)?;
    let right = Tensor::from_slice(right, &right_shape[..], &Device::Cpu)?;
    let product = match transposed {
        Transposed::Neither => left.matmul(&right)?,
        Transposed::Left => left.t()?.matmul(&right)?,
        Transposed::Right => left.matmul(&right.t()?)?,
    };
    Ok(product.flatten_all()?.to_vec1()?)
}

/// Adds up what `add` adds per cloud, in the order of the clouds.
fn cloud_sums(n_clouds: usize, width: usize, add: impl Fn(usize, &mut [f64]) + Sync) -> Vec<f64> {
    let per_cloud: Vec<Vec<f64>> = (0..n_clouds)
        .into_par_iter()
        .map(|cloud| {
            let mut sums = vec![0.0; width];
            add(cloud, &mut sums);
            sums
        })
        .collect();
    let mut total = vec![0.0; width];
    for sums in per_cloud {
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += sum;
        }
    }
    total
}

fn column_means(rows: &[f32], width: usize, points: usize) -> Vec<f64> {
    let n_rows = rows.len() / width;
    let mut sums = cloud_sums(n_rows / points, width, |cloud, sums| {
        for row in rows[cloud * points * width..(cloud + 1) * points * width].chunks_exact(width) {
            for (sum, &x) in sums.iter_mut().zip(row) {
                *sum += f64::from(x);
            }
        }
    });
    for sum in &mut sums {
        *sum /= n_rows as f64;
    }
    sums
}

fn measure(rows: &[f32], width: usize, points: usize) -> Normalized {
    let mean = column_means(rows, width, points);
    let n_rows = rows.len() / width;
    let mut variance = cloud_sums(n_rows / points, width, |cloud, sums| {
        for row in rows[cloud * points * width..(cloud + 1) * points * width].chunks_exact(width) {
            for ((sum, &x), mean) in sums.iter_mut().zip(row).zip(&mean) {
                *sum += (f64::from(x) - mean).powi(2);
            }
        }
    });
    for sum in &mut variance {
        *sum /= n_rows as f64;
    }
    Normalized { mean, variance }
}

/// Returns the covariance matrix of the columns, cloud by cloud in `f32`, summed in `f64`.
fn covariance(rows: &[f32], mean: &[f64], points: usize) -> Result<Vec<f32>, CgfError> {
    let width = mean.len();
    let mut sums = vec![0.0_f64; width * width];
    for cloud in rows.chunks_exact(points * width) {
        let centered: Vec<f32> = cloud
            .chunks_exact(width)
            .flat_map(|row| row.iter().zip(mean).map(|(&x, &mean)| x - narrow(mean)))
            .collect();
        let squares = product(&centered, [points, width], &centered, [points, width], Transposed::Left)?;
        for (sum, &square) in sums.iter_mut().zip(&squares) {
            *sum += f64::from(square);
        }
    }
    let n_rows = (rows.len() / width) as f64;
    Ok(sums.iter().map(|sum| narrow(sum / n_rows)).collect())
}

#[cfg(test)]
mod tests;
