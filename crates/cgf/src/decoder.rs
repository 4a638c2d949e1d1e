//! The continuous decoder without a tape: motions in blocks that fit a processor's cache, and their
//! exact derivatives in time (section III-B of the paper).
//!
//! The first layer is linear in time, so that its parts of the latent code and of the object are
//! computed once per motion. Every other layer is one product of matrices for a whole block; bias and
//! activation follow in one pass. For derivatives the rows [x, x′, x″] go through the layers together:
//! a matrix takes all three alike, the bias belongs to the values alone, and the activation follows
//! the chain rule (forward propagation of a truncated Taylor series: A. Griewank and A. Walther,
//! *Evaluating Derivatives*, 2nd edition 2008, chapter 13).
//! A row's numbers do not depend on what else is in its block: any set of times contains the bytes of
//! any subset, on any number of threads.

mod activation;
mod number;
mod rates;

use candle_core::{CpuStorage, Device, Storage, Tensor};
use rayon::prelude::*;

pub use self::rates::{HandRate, MovingGrasp};
use self::{
    activation::{Order, activate, add_product, first_layer},
    number::Number,
};
use crate::{
    CgfError, ObjectFeature,
    config::{Activation, NetworkConfig},
    grasp::{Grasp, Normalization},
    limits::Limits,
    weights::Weights,
};

/// Rows of values in a block: with the widest layer of the paper, 512, they fill most of a megabyte.
const ROWS: usize = 320;
/// The same where derivatives go along.
const ROWS_WITH_RATES: usize = 160;
/// Fewest rows that are multiplied at once, the rest zeros: below 64 the product of matrices chooses
/// another order of summation.
const LEAST_ROWS: usize = 80;

/// The decoder's weights, laid out for decoding with numbers of one kind.
#[derive(Debug, Clone)]
pub(crate) struct Decoder<T> {
    activation: Activation,
    /// First layer, `(1, width)`, `(latent, width)`, `(feature, width)` and `(width)`.
    per_time: Vec<T>,
    by_latent: Vec<T>,
    by_feature: Vec<T>,
    first_bias: Vec<T>,
    /// The layers after it.
    layers: Vec<Layer<T>>,
    /// What takes the last layer's products to meters, matrix entries and radians.
    scale: Vec<f64>,
    shift: Vec<f64>,
    /// Takes these to where the joints are.
    limits: Limits,
}

#[derive(Debug, Clone)]
struct Layer<T> {
    /// `(inputs, width)`, contiguous.
    weights: Tensor,
    bias: Vec<T>,
}

impl<T: Number> Decoder<T> {
    /// Lays out the weights of a network.
    ///
    /// # Errors
    ///
    /// Fails if one is missing.
    pub(crate) fn new(
        config: &NetworkConfig,
        normalization: &Normalization,
        limits: Limits,
        weights: &Weights,
    ) -> Result<Self, CgfError> {
        let numbers = |name: &str| -> Result<Vec<T>, CgfError> {
            let values = &weights.array(name)?.values;
            Ok(values.iter().map(|&x| T::from_f64(f64::from(x))).collect())
        };
        let turned = |name: &str| -> Result<(Vec<T>, [usize; 2]), CgfError> {
            let values = numbers(name)?;
            let n_inputs = match weights.array(name)?.shape.as_slice() {
                &[_, n_inputs] if n_inputs > 0 => n_inputs,
                other => {
                    return Err(CgfError::Tensor {
                        name: name.to_owned(),
                        found: format!("{other:?}"),
                        expected: "a matrix".to_owned(),
                    });
                }
            };
            let width = values.len() / n_inputs;
            let rows = |input: usize| values.iter().skip(input).step_by(n_inputs).copied();
            Ok(((0..n_inputs).flat_map(rows).collect(), [n_inputs, width]))
        };
        let layer = |idx: usize| -> Result<Layer<T>, CgfError> {
            let (values, shape) = turned(&format!("decoder.{idx}.weight"))?;
            Ok(Layer {
                weights: Tensor::from_vec(values, &shape[..], &Device::Cpu)?,
                bias: numbers(&format!("decoder.{idx}.bias"))?,
            })
        };
        let layers = (1..=config.decoder_widths.len())
            .map(layer)
            .collect::<Result<Vec<_>, _>>()?;
        let last_bias = layers.last().map_or(&[][..], |layer| &layer.bias);
        let shift = normalization.mean.iter().zip(&normalization.scale);
        let shift = shift.zip(last_bias);
        Ok(Self {
            activation: config.activation,
            per_time: numbers("decoder.0.time")?,
            by_latent: turned("decoder.0.latent")?.0,
            by_feature: turned("decoder.0.feature")?.0,
            first_bias: numbers("decoder.0.bias")?,
            shift: shift
                .map(|((mean, scale), bias)| mean + scale * bias.to_f64())
                .collect(),
            scale: normalization.scale.clone(),
            limits,
            layers,
        })
    }

    /// Decodes latent codes at `times` in 0..=1 (1 far, 0 the grasp): for each code, the hand at each
    /// time, above the table.
    ///
    /// # Errors
    ///
    /// Fails if a code or the feature does not have the network's width or the outputs are no rotation.
    pub(crate) fn decode(
        &self,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<Grasp>>, CgfError> {
        self.motions(feature, latents, times, Order::Values, &|[outputs, ..]| {
            let outputs = outputs.iter().zip(self.scale.iter().zip(&self.shift));
            let mut numbers: Vec<f64> = outputs
                .map(|(y, (scale, shift))| y.to_f64() * scale + shift)
                .collect();
            self.limits.apply(&mut numbers);
            let grasp = Grasp::from_numbers(&numbers)?;
            Some(grasp.moved(&feature.table_from_network))
        })
    }

    /// Decodes as [`Decoder::decode`], with velocities and accelerations with respect to the time.
    ///
    /// # Errors
    ///
    /// Fails as it does.
    pub(crate) fn decode_with_rates(
        &self,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<MovingGrasp>>, CgfError> {
        let order = Order::Derivatives;
        self.motions(feature, latents, times, order, &|[
            values,
            firsts,
            seconds,
        ]| {
            let numbers = |outputs: &[T]| -> Vec<f64> {
                let outputs = outputs.iter().zip(&self.scale);
                outputs.map(|(y, scale)| y.to_f64() * scale).collect()
            };
            let mut numbers = [values, firsts, seconds].map(numbers);
            for (x, shift) in numbers[0].iter_mut().zip(&self.shift) {
                *x += shift;
            }
            self.limits.apply_with_rates(&mut numbers);
            let moving = rates::moving_grasp(&numbers)?;
            Some(moving.moved(&feature.table_from_network))
        })
    }

    /// Decodes block by block; `finish` makes the hand of one time's products: values, and first and
    /// second derivatives if `order` asks for them.
    fn motions<G: Send>(
        &self,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
        times: &[f64],
        order: Order,
        finish: &(dyn Fn([&[T]; 3]) -> Option<G> + Sync),
    ) -> Result<Vec<Vec<G>>, CgfError> {
        if times.is_empty() {
            return Ok(latents.iter().map(|_| Vec::new()).collect());
        }
        let object = self.object(&feature.values)?;
        let rows = match order {
            Order::Values => ROWS,
            Order::Derivatives => ROWS_WITH_RATES,
        };
        let blocks = latents.par_chunks((rows / times.len()).max(1));
        let motions: Vec<Vec<Vec<G>>> = blocks
            .map(|latents| {
                let known = self.known(&object, latents)?;
                let mut motions: Vec<Vec<G>> = latents.iter().map(|_| Vec::new()).collect();
                for times in times.chunks(rows) {
                    let block = self.block(&known, times, order)?;
                    self.read(&block, times.len(), order, &mut motions, finish)?;
                }
                Ok(motions)
            })
            .collect::<Result<_, CgfError>>()?;
        Ok(motions.into_iter().flatten().collect())
    }

    /// Returns what the first layer knows of the object, with its bias.
    fn object(&self, feature: &[f32]) -> Result<Vec<T>, CgfError> {
        let width = self.first_bias.len();
        check_width("feature", feature.len(), self.by_feature.len() / width)?;
        let feature: Vec<T> = feature.iter().map(|&x| T::from_f64(f64::from(x))).collect();
        let mut object = self.first_bias.clone();
        add_product(&mut object, &feature, &self.by_feature, width);
        Ok(object)
    }

    /// Returns what the first layer knows of each motion, `(motions, width)`.
    fn known(&self, object: &[T], latents: &[Vec<f64>]) -> Result<Vec<T>, CgfError> {
        let width = object.len();
        for latent in latents {
            check_width("latent", latent.len(), self.by_latent.len() / width)?;
        }
        let codes: Vec<T> = latents.iter().flatten().map(|&z| T::from_f64(z)).collect();
        let mut known = object.repeat(latents.len());
        add_product(&mut known, &codes, &self.by_latent, width);
        Ok(known)
    }

    /// Returns the last layer's products, without its bias, of all motions at all times: rows padded
    /// to [`LEAST_ROWS`], once or three times.
    fn block(&self, known: &[T], times: &[f64], order: Order) -> Result<Tensor, CgfError> {
        let width = self.first_bias.len();
        let times: Vec<T> = times.iter().map(|&t| T::from_f64(t)).collect();
        let rows = (known.len() / width * times.len()).max(LEAST_ROWS);
        let (activation, per_time) = (self.activation, &self.per_time);
        let first = first_layer(activation, known, per_time, &times, order, rows);
        let all_rows = order.blocks() * rows;
        let mut x = Tensor::from_vec(first, (all_rows, width), &Device::Cpu)?;
        for (idx, layer) in self.layers.iter().enumerate() {
            x = x.matmul(&layer.weights)?;
            if idx + 1 < self.layers.len() {
                let outputs = with_numbers(&x, |products| {
                    activate(activation, products, &layer.bias, order)
                })?;
                x = Tensor::from_vec(outputs, (all_rows, layer.bias.len()), &Device::Cpu)?;
            }
        }
        Ok(x)
    }

    /// Takes the products of a block to the hands of its motions.
    fn read<G>(
        &self,
        block: &Tensor,
        n_times: usize,
        order: Order,
        motions: &mut [Vec<G>],
        finish: &(dyn Fn([&[T]; 3]) -> Option<G> + Sync),
    ) -> Result<(), CgfError> {
        let width = self.scale.len();
        let not_finite = || CgfError::NotFinite {
            name: "decoder".to_owned(),
            what: "a decoded rotation",
        };
        with_numbers(block, |products: &[T]| {
            let stride = products.len() / order.blocks();
            let rows = products.chunks_exact(width).take(stride / width);
            let mut rows = rows.enumerate().map(|(row, values)| {
                let rate = |number: usize| match order {
                    Order::Values => &[][..],
                    Order::Derivatives => {
                        let from = number * stride + row * width;
                        products.get(from..from + width).unwrap_or(&[])
                    }
                };
                finish([values, rate(1), rate(2)])
            });
            for motion in motions {
                for grasp in rows.by_ref().take(n_times) {
                    motion.push(grasp.ok_or_else(not_finite)?);
                }
            }
            Ok(())
        })?
    }
}

/// Calls `read` with a contiguous tensor's numbers, which are not copied.
fn with_numbers<T: Number, R>(
    tensor: &Tensor,
    read: impl FnOnce(&[T]) -> R,
) -> Result<R, CgfError> {
    let contiguous = || candle_core::Error::RequiresContiguous { op: "decode" }.bt();
    let (storage, layout) = tensor.storage_and_layout();
    let (start, end) = layout.contiguous_offsets().ok_or_else(contiguous)?;
    let Storage::Cpu(storage) = &*storage else {
        return Err(contiguous().into());
    };
    let numbers = CpuStorage::as_slice::<T>(storage)?;
    Ok(read(numbers.get(start..end).unwrap_or(&[])))
}

fn check_width(key: &'static str, found: usize, expected: usize) -> Result<(), CgfError> {
    if found == expected {
        return Ok(());
    }
    Err(CgfError::Config {
        key,
        value: format!("{found} numbers"),
        expected: "as many numbers as the network was made for",
    })
}

#[cfg(test)]
mod tests;
