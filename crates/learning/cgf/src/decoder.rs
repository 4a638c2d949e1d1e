//! The continuous decoder without a tape: motions in blocks that fit a processor's cache, and their
//! exact derivatives in time (section III-B of the paper).
//!
//! The first layer is linear in time, so that its parts of the latent code and of the object are
//! computed once per motion. Every other layer is a product with sixteen rows at a time, without the
//! channels that an activation has set to zero in all of them: with `ReLU` about half; bias and activation
//! follow in one pass. For derivatives the rows [x, x′, x″] go through the layers together:
//! a matrix takes all three alike, the bias belongs to the values alone, and the activation follows
//! the chain rule (forward propagation of a truncated Taylor series: A. Griewank and A. Walther,
//! *Evaluating Derivatives*, 2nd edition 2008, chapter 13).
//! A row's numbers do not depend on what else is in its block: any set of times contains the bytes of
//! any subset, on any number of threads.

mod activation;
mod number;
mod rates;

use motion::HandState;
use rayon::prelude::*;

pub use self::rates::{HandDerivative, HandMotionState};
use self::{
    activation::{DerivativeLevel, Start, activate, add_product},
    number::Number,
};
use crate::{
    CgfError,
    config::Activation,
    hand_numbers::{self, Normalization},
    limits::Limits,
    product::{LANES, PackedMatrix, Row, Sparse},
    weights::Weights,
};

/// Rows that a thread takes at a time: sixteen motions of forty steps.
const ROWS: usize = 640;
/// Patches that go from layer to layer together: with the widest layer of the paper, 512, their numbers
/// take a quarter of a megabyte, so that they and the weights fit a processor's second cache.
const PATCHES: usize = 8;

/// The decoder's weights, laid out for decoding with numbers of one kind.
#[derive(Debug, Clone)]
pub(crate) struct Decoder<T> {
    activation: Activation,
    /// First layer, `(1, width)`, of the latent code, `(feature, width)` and `(width)`.
    per_time: Vec<T>,
    by_latent: PackedMatrix<T>,
    by_feature: Vec<T>,
    first_bias: Vec<T>,
    /// The layers after it.
    layers: Vec<Layer<T>>,
    /// Scale and offset from the last layer's products to meters, matrix entries and radians.
    scale: Vec<f64>,
    shift: Vec<f64>,
    /// Map from these numbers to joint positions.
    limits: Limits,
}

#[derive(Debug, Clone)]
struct Layer<T> {
    weights: PackedMatrix<T>,
    bias: Vec<T>,
    /// As many zeros as there are numbers in the bias.
    zeros: Vec<T>,
}

impl<T: Number> Decoder<T> {
    /// Lays out the weights of a decoder of this name and number of hidden layers.
    ///
    /// # Errors
    ///
    /// Fails if one is missing.
    pub(crate) fn new(
        (decoder, hidden): (&str, usize),
        activation: Activation,
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
        let packed = |name: &str| -> Result<PackedMatrix<T>, CgfError> {
            let (values, [n_inputs, width]) = turned(name)?;
            let entry = |output: usize, input: usize| values[input * width + output];
            Ok(PackedMatrix::new(width, n_inputs, entry))
        };
        let layer = |idx: usize| -> Result<Layer<T>, CgfError> {
            let bias = numbers(&format!("{decoder}.{idx}.bias"))?;
            Ok(Layer {
                weights: packed(&format!("{decoder}.{idx}.weight"))?,
                zeros: vec![T::zero(); bias.len()],
                bias,
            })
        };
        let layers = (1..=hidden).map(layer).collect::<Result<Vec<_>, _>>()?;
        let last_bias = layers.last().map_or(&[][..], |layer| &layer.bias);
        let shift = normalization.mean.iter().zip(&normalization.scale);
        let shift = shift.zip(last_bias);
        Ok(Self {
            activation,
            per_time: numbers(&format!("{decoder}.0.time"))?,
            by_latent: packed(&format!("{decoder}.0.latent"))?,
            by_feature: turned(&format!("{decoder}.0.feature"))?.0,
            first_bias: numbers(&format!("{decoder}.0.bias"))?,
            shift: shift
                .map(|((mean, scale), bias)| mean + scale * bias.to_f64())
                .collect(),
            scale: normalization.scale.clone(),
            limits,
            layers,
        })
    }

    /// Decodes latent codes at `times` in 0..=1 (1 far, 0 the grasp): for each code, the hand at each
    /// time, in the frame of the outputs.
    ///
    /// # Errors
    ///
    /// Fails if a code or the feature does not have the network's width or the outputs are not a rotation.
    pub(crate) fn decode<F: Send>(
        &self,
        feature: &[f32],
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<HandState<F>>>, CgfError> {
        let level = DerivativeLevel::Values;
        self.motions(feature, latents, times, level, &|[outputs, ..]| {
            let outputs = outputs.iter().zip(self.scale.iter().zip(&self.shift));
            let mut numbers: Vec<f64> = outputs
                .map(|(y, (scale, shift))| y.to_f64() * scale + shift)
                .collect();
            self.limits.apply(&mut numbers);
            hand_numbers::to_hand(&numbers)
        })
    }

    /// Decodes as [`Decoder::decode`], with velocities and accelerations with respect to the time.
    ///
    /// # Errors
    ///
    /// Fails as it does.
    pub(crate) fn decode_with_rates<F: Send>(
        &self,
        feature: &[f32],
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<HandMotionState<F>>>, CgfError> {
        let level = DerivativeLevel::Derivatives;
        self.motions(feature, latents, times, level, &|[
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
            rates::moving_grasp(&numbers)
        })
    }

    /// Decodes block by block; `finish` makes the hand of one time's products: values, and first and
    /// second derivatives if `level` asks for them.
    fn motions<G: Send>(
        &self,
        feature: &[f32],
        latents: &[Vec<f64>],
        times: &[f64],
        level: DerivativeLevel,
        finish: &(dyn Fn([&[T]; 3]) -> Option<G> + Sync),
    ) -> Result<Vec<Vec<G>>, CgfError> {
        if times.is_empty() {
            return Ok(latents.iter().map(|_| Vec::new()).collect());
        }
        let object = self.object(feature)?;
        let times: Vec<T> = times.iter().map(|&t| T::from_f64(t)).collect();
        let motions: Vec<Vec<Vec<G>>> = latents
            .par_chunks((ROWS / times.len()).max(1))
            .map(|latents| {
                let start = Start {
                    n_motions: latents.len(),
                    motions: &self.known(&object, latents)?,
                    per_time: &self.per_time,
                    times: &times,
                };
                let mut hands = self.hands(&start, level, finish)?.into_iter();
                let motions = latents
                    .iter()
                    .map(|_| hands.by_ref().take(times.len()).collect());
                Ok(motions.collect())
            })
            .collect::<Result<_, CgfError>>()?;
        Ok(motions.into_iter().flatten().collect())
    }

    /// Returns the object's contribution to the first layer, with its bias.
    fn object(&self, feature: &[f32]) -> Result<Vec<T>, CgfError> {
        let width = self.first_bias.len();
        check_width("feature", feature.len(), self.by_feature.len() / width)?;
        let feature: Vec<T> = feature.iter().map(|&x| T::from_f64(f64::from(x))).collect();
        let mut object = self.first_bias.clone();
        add_product(&mut object, &feature, &self.by_feature);
        Ok(object)
    }

    /// Returns the part of the first layer that is constant in time, for sixteen motions side by side.
    fn known(&self, object: &[T], latents: &[Vec<f64>]) -> Result<Vec<Row<T>>, CgfError> {
        for latent in latents {
            check_width("latent", latent.len(), self.by_latent.inputs())?;
        }
        let patches = latents.chunks(LANES).map(|latents| {
            let mut patch = Sparse::default();
            for (channel, k) in (0_u32..).zip(0..self.by_latent.inputs()) {
                let mut row = [T::zero(); LANES];
                for (x, latent) in row.iter_mut().zip(latents) {
                    *x = T::from_f64(latent[k]);
                }
                patch.push(channel, row);
            }
            patch
        });
        let patches: Vec<Sparse<T>> = patches.collect();
        let mut known = vec![[T::zero(); LANES]; patches.len() * object.len()];
        T::project(&self.by_latent, &patches, object, &mut known);
        Ok(known)
    }

    /// Takes rows through all layers, some patches at a time, and makes their hands.
    fn hands<G>(
        &self,
        start: &Start<'_, T>,
        level: DerivativeLevel,
        finish: &(dyn Fn([&[T]; 3]) -> Option<G> + Sync),
    ) -> Result<Vec<G>, CgfError> {
        let rows = start.rows();
        let blocks = level.blocks();
        let mut inputs = vec![Sparse::default(); PATCHES * blocks];
        let mut products: Vec<Row<T>> = Vec::new();
        let mut hands = Vec::with_capacity(rows);
        for first in (0..rows).step_by(PATCHES * LANES) {
            let n = (rows - first).min(PATCHES * LANES);
            let inputs = &mut inputs[..n.div_ceil(LANES) * blocks];
            start.layer(self.activation, first, level, inputs);
            for (idx, layer) in self.layers.iter().enumerate() {
                products.resize(inputs.len() * layer.bias.len(), [T::zero(); LANES]);
                T::project(&layer.weights, inputs, &layer.zeros, &mut products);
                if idx + 1 < self.layers.len() {
                    activate(self.activation, &products, &layer.bias, level, inputs);
                }
            }
            self.read(&products, n, level, &mut hands, finish)?;
        }
        Ok(hands)
    }

    /// Takes the last layer's products, without its bias, of `n` rows to hands.
    fn read<G>(
        &self,
        products: &[Row<T>],
        n: usize,
        level: DerivativeLevel,
        hands: &mut Vec<G>,
        finish: &(dyn Fn([&[T]; 3]) -> Option<G> + Sync),
    ) -> Result<(), CgfError> {
        let width = self.scale.len();
        let not_finite = || CgfError::NotFinite {
            name: "decoder".to_owned(),
            what: "a decoded rotation",
        };
        let mut numbers = vec![T::zero(); level.blocks() * width];
        let patches = products.chunks_exact(level.blocks() * width);
        let rows = patches.flat_map(|patch| (0..LANES).map(move |lane| (patch, lane)));
        for (patch, lane) in rows.take(n) {
            for (number, channel) in numbers.iter_mut().zip(patch) {
                *number = channel[lane];
            }
            let (values, rates) = numbers.split_at(width);
            let (firsts, seconds) = rates.split_at(rates.len() / 2);
            hands.push(finish([values, firsts, seconds]).ok_or_else(not_finite)?);
        }
        Ok(())
    }
}

/// Checks the width of a row of numbers.
pub(crate) fn check_width(
    what: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), CgfError> {
    if found == expected {
        return Ok(());
    }
    Err(CgfError::WrongWidth {
        what,
        expected,
        found,
    })
}

#[cfg(test)]
mod tests;
