//! The object features on candle's tape: the fast form as one operation of all the point network's
//! numbers with its gradient by hand, and a plain form in candle's operations for other devices.

use std::sync::{Arc, Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp1, Device, Layout, Shape, Tensor};

use super::{Clouds, EPSILON, Layer, Normalized, Pass, PointNet, Statistics, names};
use crate::{
    CgfError,
    weights::{WeightTensors, leaf},
};

/// Means and unbiased variances that a pass measured, by the names of the arrays that store them.
pub(crate) type Measured = Vec<(String, Vec<f32>)>;

/// Computes the features of clouds, `(clouds, width)`, with a gradient by every learned array of the
/// point network among `leaves`, and the statistics with which the pass normalized.
///
/// On the CPU this is the fast form, on other devices the plain one.
pub(crate) fn features(
    leaves: &WeightTensors,
    n_layers: usize,
    clouds: &Arc<Clouds>,
    statistics: Statistics,
) -> Result<(Tensor, Measured), CgfError> {
    match leaf(leaves, &names(0)[0])?.device() {
        Device::Cpu => fast(leaves, n_layers, clouds, statistics),
        Device::Cuda(_) | Device::Metal(_) => plain(leaves, n_layers, clouds, statistics),
    }
}

fn fast(
    leaves: &WeightTensors,
    n_layers: usize,
    clouds: &Arc<Clouds>,
    statistics: Statistics,
) -> Result<(Tensor, Measured), CgfError> {
    let numbers = |name: String| Ok::<_, CgfError>(leaf(leaves, &name)?.to_vec1::<f32>()?);
    let mut flat = Vec::with_capacity(3 * n_layers);
    let mut layers = Vec::with_capacity(n_layers);
    for idx in 0..n_layers {
        let [weight, gain, shift] = names(idx).map(|name| leaf(leaves, &name));
        let (weight, gain, shift) = (weight?, gain?, shift?);
        let (outputs, inputs) = weight.dims2()?;
        let widened = |name: &str| {
            let stored = numbers(format!("point_net.{idx}.{name}"))?;
            Ok::<_, CgfError>(stored.into_iter().map(f64::from).collect())
        };
        layers.push(Layer {
            inputs,
            outputs,
            weight: weight.flatten_all()?.to_vec1()?,
            gain: gain.to_vec1()?,
            shift: shift.to_vec1()?,
            stored: Normalized {
                mean: widened("mean")?,
                variance: widened("variance")?,
            },
        });
        flat.extend([weight.flatten_all()?, gain.clone(), shift.clone()]);
    }
    let pass = Arc::new(Mutex::new(None));
    let features = Tensor::cat(&flat, 0)?.apply_op1(Features {
        net: PointNet { layers },
        clouds: clouds.clone(),
        statistics,
        pass: pass.clone(),
    })?;
    let pass = pass.lock().unwrap_or_else(PoisonError::into_inner);
    let measured = pass.as_ref().map_or_else(Vec::new, Pass::measured);
    Ok((features, measured))
}

/// All learned numbers of the point network, layer by layer, to the features of some clouds.
struct Features {
    net: PointNet,
    clouds: Arc<Clouds>,
    statistics: Statistics,
    /// Intermediate results of the forward pass, taken by the backward pass.
    pass: Arc<Mutex<Option<Pass>>>,
}

impl CustomOp1 for Features {
    fn name(&self) -> &'static str {
        "object_features"
    }

    /// The argument is there for the tape alone: its numbers are `net`'s.
    fn cpu_fwd(&self, _: &CpuStorage, _: &Layout) -> candle_core::Result<(CpuStorage, Shape)> {
        let mut pass = self.net.forward(&self.clouds, self.statistics);
        let features = std::mem::take(&mut pass.features);
        let width = self.net.layers[self.net.last()].outputs;
        let shape = Shape::from((features.len() / width, width));
        *self.pass.lock().unwrap_or_else(PoisonError::into_inner) = Some(pass);
        Ok((CpuStorage::F32(features), shape))
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, by: &Tensor) -> candle_core::Result<Option<Tensor>> {
        let mut pass = self.pass.lock().unwrap_or_else(PoisonError::into_inner);
        let pass = pass.take().ok_or_else(|| {
            candle_core::Error::Msg("the features' gradient was already taken".to_owned())
        })?;
        let by = by.flatten_all()?.to_vec1::<f32>()?;
        let gradients = self.net.backward(pass, &by);
        let flat: Vec<f32> = gradients.into_iter().flatten().flatten().collect();
        let n = flat.len();
        Tensor::from_vec(flat, n, &Device::Cpu).map(Some)
    }
}

/// The same in candle's own operations: `(points, width)` tensors at every layer.
pub(crate) fn plain(
    leaves: &WeightTensors,
    n_layers: usize,
    clouds: &Clouds,
    statistics: Statistics,
) -> Result<(Tensor, Measured), CgfError> {
    let points = clouds.points;
    let rows = clouds.xyz.len() / 3;
    let device = leaf(leaves, &names(0)[0])?.device();
    let mut x = Tensor::from_slice(&clouds.xyz, (rows, 3), device)?;
    let mut measured = Measured::new();
    for idx in 0..n_layers {
        let [weight, gain, shift] = names(idx).map(|name| leaf(leaves, &name));
        let stored = ["mean", "variance"].map(|name| format!("point_net.{idx}.{name}"));
        let y = x.matmul(&weight?.t()?)?;
        let (mean, variance) = match statistics {
            Statistics::Measured => {
                let mean = y.mean_keepdim(0)?;
                let variance = y.broadcast_sub(&mean)?.sqr()?.mean_keepdim(0)?;
                (mean, variance)
            }
            Statistics::Stored => {
                let [mean, variance] = stored.each_ref().map(|name| leaf(leaves, name));
                (mean?.unsqueeze(0)?, variance?.unsqueeze(0)?)
            }
        };
        let unbiased = (&variance * (rows as f64 / (rows as f64 - 1.0).max(1.0)))?;
        for (name, values) in stored.into_iter().zip([&mean, &unbiased]) {
            measured.push((name, values.flatten_all()?.to_vec1()?));
        }
        let sigma = (variance + EPSILON)?.sqrt()?;
        let normalized = y.broadcast_sub(&mean)?.broadcast_div(&sigma)?;
        x = normalized.broadcast_mul(gain?)?.broadcast_add(shift?)?;
        if idx + 1 < n_layers {
            x = x.relu()?;
        }
    }
    let width = x.dim(1)?;
    let x = x.reshape((rows / points, points, width))?;
    // One point of each cloud takes the gradient, where `max` would give it to all that are equal.
    let at = x.detach().argmax_keepdim(1)?;
    Ok((x.gather(&at, 1)?.squeeze(1)?, measured))
}
