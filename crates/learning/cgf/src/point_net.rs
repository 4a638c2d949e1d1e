//! The object feature: a network over surface points (Qi et al., *PointNet*, 2017, §4.2 without its
//! transforms), computed exactly but without the tensors that make it slow.
//!
//! Every layer is a matrix per point and batch normalization (Ioffe and Szegedy 2015, algorithm 1);
//! all but the last end in `max(x, 0)`, and the last in the maximum over the points of a cloud.
//! Reasons for its speed, all of them exact:
//!
//! - A layer's statistics over all points follow from the mean and the covariance of the layer below,
//!   because it is linear: they are known before the layer itself is computed, and the last one, the
//!   widest, is never normalized but at the points that attain a maximum.
//! - The search for the maximum keeps its products in registers; its `(points, width)` tensor is
//!   never made. Backward, the maximum has a sparse part at those points and, where the statistics
//!   were measured, a part of the rank of the layer below.
//! - Points that lie near each other are worked on together, sixteen at a time. About four in ten
//!   channels are zero at all sixteen, and are left out.
//!
//! Forward and backward are written by hand; `f64` carries every sum over points beyond a few hundred.

mod backward;
mod cloud;
mod kernel;
mod moments;
mod order;
mod search;
mod tape;

use rayon::prelude::*;

pub(crate) use self::tape::{Measured, features};
use self::{cloud::Cloud, moments::Moments, search::Columns};
use crate::{
    CgfError, config::Initialization, precision::narrow, product::PackedMatrix, random::Random,
    weights::Weights,
};

/// Added to variances before their root is taken.
const EPSILON: f64 = 1e-5;

/// Source of the means and variances that normalize the layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Statistics {
    /// Those of the points at hand.
    Measured,
    /// Those stored with the weights.
    Stored,
}

/// Clouds of equally many points.
#[derive(Debug, Clone, PartialEq, Default)]
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
    /// Its stored statistics, for [`Statistics::Stored`].
    stored: Normalized,
}

/// The point network.
#[derive(Debug, Clone)]
pub(crate) struct PointNet {
    layers: Vec<Layer>,
}

/// Statistics that normalize one layer: mean and variance per output.
#[derive(Debug, Clone)]
struct Normalized {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

/// Scale and offset of `gain (y − mean) / sigma + shift`, for each output.
#[derive(Debug, Clone)]
struct Affine {
    scale: Vec<f32>,
    offset: Vec<f32>,
}

/// Intermediate results of a forward pass that the backward pass needs.
pub(crate) struct Pass {
    statistics: Statistics,
    clouds: Vec<Cloud>,
    /// Points of all clouds.
    points: usize,
    normalized: Vec<Normalized>,
    affine: Vec<Affine>,
    /// Moments of each layer's input over all points, where statistics were measured.
    moments: Vec<Moments>,
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

/// Shifts the last layer so that the features of clouds start with mean 0: maxima of normal numbers are all positive,
/// and what they share would drown what they tell apart.
pub(crate) fn center(
    weights: &mut Weights,
    n_layers: usize,
    clouds: &Clouds,
) -> Result<(), CgfError> {
    let net = PointNet::new(weights, n_layers)?;
    let name = format!("point_net.{}.shift", n_layers - 1);
    let width = weights.array(&name)?.values.len();
    let features = net.forward(clouds, Statistics::Measured).features;
    let n = (features.len() / width) as f32;
    let mut shift = vec![0.0; width];
    for feature in features.chunks_exact(width) {
        for (shift, x) in shift.iter_mut().zip(feature) {
            *shift -= x / n;
        }
    }
    weights.set(&name, &[width], shift);
    Ok(())
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
                let widen =
                    |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<f64>>();
                let (weight, gain) = (values("weight")?, values("gain")?);
                Ok(Layer {
                    inputs: weight.len() / gain.len().max(1),
                    outputs: gain.len(),
                    weight,
                    gain,
                    shift: values("shift")?,
                    stored: Normalized {
                        mean: widen(values("mean")?),
                        variance: widen(values("variance")?),
                    },
                })
            })
            .collect::<Result<_, CgfError>>()?;
        Ok(Self { layers })
    }

    /// Computes the feature of every cloud.
    pub(crate) fn forward(&self, clouds: &Clouds, statistics: Statistics) -> Pass {
        let mut states: Vec<Cloud> = clouds
            .xyz
            .par_chunks_exact(3 * clouds.points)
            .map(Cloud::of_neighbors)
            .collect();
        let mut layer_stack = LayerStack::new(self);
        let mut moments = Vec::new();
        match statistics {
            Statistics::Measured => {
                for level in 0..self.layers.len() {
                    let parts: Vec<Moments> = states
                        .par_iter_mut()
                        .map(|cloud| cloud.measure(&layer_stack, level))
                        .collect();
                    let mut all = Moments::default();
                    for part in &parts {
                        all.add(part);
                    }
                    layer_stack.normalize(self.layers[level].normalized_from(&all));
                    moments.push(all);
                }
            }
            Statistics::Stored => {
                for layer in &self.layers {
                    layer_stack.normalize(layer.stored.clone());
                }
                states
                    .par_iter_mut()
                    .for_each(|cloud| cloud.search(&layer_stack));
            }
        }
        let LayerStack {
            normalized, affine, ..
        } = layer_stack;
        let mut features = Vec::with_capacity(states.len() * self.layers[self.last()].outputs);
        let top = &affine[self.last()];
        for cloud in &states {
            let attained = cloud.attained.iter().zip(&top.scale).zip(&top.offset);
            features.extend(attained.map(|((y, scale), offset)| scale * y + offset));
        }
        Pass {
            statistics,
            points: states.len() * clouds.points,
            clouds: states,
            normalized,
            affine,
            moments,
            features,
        }
    }

    fn last(&self) -> usize {
        self.layers.len() - 1
    }
}

/// The layers as one pass uses them.
struct LayerStack<'a> {
    layers: &'a [Layer],
    /// Each layer's matrix but the first's.
    packed: Vec<PackedMatrix>,
    /// The last layer's matrix, rows of negative gain turned over: the largest value
    /// after normalization is the largest of its products.
    signed: Columns,
    /// As far as they are known.
    normalized: Vec<Normalized>,
    affine: Vec<Affine>,
}

impl<'a> LayerStack<'a> {
    fn new(net: &'a PointNet) -> Self {
        let layers = &net.layers;
        let pack = |layer: &Layer| {
            PackedMatrix::new(layer.outputs, layer.inputs, |output, input| {
                layer.weight[output * layer.inputs + input]
            })
        };
        let top = &layers[net.last()];
        Self {
            layers,
            packed: layers[..net.last()].iter().skip(1).map(pack).collect(),
            signed: Columns::new(top.outputs, top.inputs, |output, input| {
                let weight = top.weight[output * top.inputs + input];
                if top.gain[output] < 0.0 {
                    -weight
                } else {
                    weight
                }
            }),
            normalized: Vec::new(),
            affine: Vec::new(),
        }
    }

    fn normalize(&mut self, normalized: Normalized) {
        let layer = &self.layers[self.normalized.len()];
        self.affine.push(layer.affine(&normalized));
        self.normalized.push(normalized);
    }
}

impl Pass {
    /// Moves the stored statistics a share of the way to those measured in this pass.
    pub(crate) fn store(&self, momentum: f32, weights: &mut Weights) -> Result<(), CgfError> {
        store(&self.measured(), momentum, weights)
    }

    /// Mean and unbiased variance of each layer, by the arrays' names.
    fn measured(&self) -> Measured {
        // The stored variance is unbiased, the one for normalization is not.
        let n = self.points as f64;
        let unbias = n / (n - 1.0).max(1.0);
        let narrowed = |values: &[f64], factor: f64| -> Vec<f32> {
            values.iter().map(|x| narrow(x * factor)).collect()
        };
        let mut measured = Measured::new();
        for (layer, normalized) in self.normalized.iter().enumerate() {
            for (name, values) in [
                ("mean", narrowed(&normalized.mean, 1.0)),
                ("variance", narrowed(&normalized.variance, unbias)),
            ] {
                measured.push((format!("point_net.{layer}.{name}"), values));
            }
        }
        measured
    }
}

/// Moves the stored statistics a share of the way to measured ones.
pub(crate) fn store(
    measured: &Measured,
    momentum: f32,
    weights: &mut Weights,
) -> Result<(), CgfError> {
    for (name, measured) in measured {
        let stored = &weights.array(name)?.values;
        let moved = stored
            .iter()
            .zip(measured)
            .map(|(&stored, &measured)| stored + momentum * (measured - stored))
            .collect::<Vec<f32>>();
        weights.set(name, &[moved.len()], moved);
    }
    Ok(())
}

impl Layer {
    fn affine(&self, normalized: &Normalized) -> Affine {
        let (scale, offset) = (0..self.outputs)
            .map(|c| {
                let scale = f64::from(self.gain[c]) / (normalized.variance[c] + EPSILON).sqrt();
                let offset = f64::from(self.shift[c]) - scale * normalized.mean[c];
                (narrow(scale), narrow(offset))
            })
            .unzip();
        Affine { scale, offset }
    }

    /// Returns mean and variance of every output, from the moments of the input.
    fn normalized_from(&self, moments: &Moments) -> Normalized {
        let (mean, variance) = self
            .weight
            .par_chunks(self.inputs)
            .map(|weight| {
                let (mean, variance, _) = moments.of_product(weight);
                (mean, variance)
            })
            .unzip();
        Normalized { mean, variance }
    }
}

#[cfg(test)]
mod tests;
