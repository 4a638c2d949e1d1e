//! The object feature: a network over surface points (Qi et al., *PointNet*, 2017, §4.2 without its
//! transforms), computed exactly but without the tensors that make it slow.
//!
//! Every layer is a matrix per point and batch normalization (Ioffe and Szegedy 2015, algorithm 1);
//! all but the last end in `max(x, 0)`, and the last in the maximum over the points of a cloud.
//! Only the points that attain a maximum matter to the last layer, and its statistics over all points
//! follow from the mean and the covariance of the layer below, because it is linear. Its
//! `(clouds × points, width)` tensor is therefore made one cloud at a time and never kept.
//! Forward and backward are written by hand; `f64` carries every sum over points.

mod backward;
mod rows;

use rayon::prelude::*;

use self::rows::{Transposed, column_means, covariance, measure, product};
use crate::{
    CgfError, config::Initialization, precision::narrow, random::Random, weights::Weights,
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
pub(crate) fn initialize(
    weights: &mut Weights,
    widths: &[usize],
    initialization: Initialization,
    random: &mut Random,
) {
    let mut inputs = 3;
    for (layer, &outputs) in widths.iter().enumerate() {
        let name = format!("point_net.{layer}.weight");
        let bound = initialization.bound(inputs);
        weights.set_random(&name, &[outputs, inputs], bound, random);
        for (name, value) in [
            ("gain", 1.0),
            ("shift", 0.0),
            ("mean", 0.0),
            ("variance", 1.0),
        ] {
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
                    Ok::<_, CgfError>(
                        weights
                            .array(&format!("point_net.{layer}.{name}"))?
                            .values
                            .clone(),
                    )
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
    pub(crate) fn forward(
        &self,
        clouds: &Clouds,
        statistics: Statistics,
    ) -> Result<Pass, CgfError> {
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
            let linear = product(
                below,
                [rows, layer.inputs],
                &layer.weight,
                [layer.outputs, layer.inputs],
                Transposed::Right,
            )?;
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
                    for (above, linear) in above
                        .chunks_exact_mut(layer.outputs)
                        .zip(linear.chunks_exact(layer.outputs))
                    {
                        for (((above, &y), &scale), &offset) in
                            above.iter_mut().zip(linear).zip(&scale).zip(&offset)
                        {
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
            let values = product(
                rows,
                [points, inputs],
                &signed,
                [outputs, inputs],
                Transposed::Right,
            )?;
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

    /// Moves the stored statistics a share of the way to those measured in a pass.
    pub(crate) fn store(pass: &Pass, momentum: f32, weights: &mut Weights) -> Result<(), CgfError> {
        let rows = (pass.n_clouds * pass.points) as f64;
        for (layer, normalized) in pass.normalized.iter().enumerate() {
            // The stored variance is unbiased, the one normalized with is not.
            let variance: Vec<f64> = normalized
                .variance
                .iter()
                .map(|v| v * rows / (rows - 1.0))
                .collect();
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
                let dot = |row: &[f32]| -> f64 {
                    row.iter().zip(&w).map(|(&x, w)| f64::from(x) * w).sum()
                };
                let variance: f64 = covariance
                    .chunks_exact(n)
                    .zip(&w)
                    .map(|(row, w)| w * dot(row))
                    .sum();
                let mean: f64 = mean.iter().zip(&w).map(|(m, w)| m * w).sum();
                (mean, variance.max(0.0))
            })
            .unzip();
        Normalized { mean, variance }
    }
}

#[cfg(test)]
mod tests;
