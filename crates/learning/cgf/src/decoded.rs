//! From a batch's codes to hands, on the tape.

use candle_core::{DType, Tensor};
use motion::HandState;
use rayon::prelude::*;

use crate::{
    CgfError, basis_points,
    batch::Batch,
    config::LatentNoise,
    data::NetworkFrame,
    hand_numbers::{Normalization, PALM_WIDTH},
    network::{Curve, Network},
    precision::{narrow, narrow_all},
    step::Objective,
    weights::leaf,
};

/// The codes of a batch's motions.
pub(crate) struct Codes {
    /// Of each motion, `(batch, latent)`.
    pub(crate) of_motions: Tensor,
    /// Of each time, `(batch × times, latent)`, if every time is a motion of its own.
    of_times: Option<Tensor>,
}

/// A decoded batch.
pub(crate) struct Decoded {
    /// `(batch × times, outputs)` in the network's units, and in physical ones.
    pub(crate) rows: Tensor,
    pub(crate) physical: Tensor,
    /// Squared error of the first decoder's grasps, if a second one starts from them.
    pub(crate) coarse: Tensor,
}

/// Repeats the row of each motion, `(batch, width)`, for each of its times.
fn per_time(rows: &Tensor, n_times: usize) -> Result<Tensor, CgfError> {
    let (size, width) = rows.dims2()?;
    let repeated = rows.unsqueeze(1)?.broadcast_as((size, n_times, width))?;
    Ok(repeated.reshape((size * n_times, width))?)
}

impl Objective<'_> {
    /// Encodes a batch's motions: their codes, and means and log-variances of the encoder's.
    pub(crate) fn encoded(
        &self,
        batch: &Batch,
        tape: &Network,
        features: &Tensor,
    ) -> Result<(Codes, [Tensor; 2]), CgfError> {
        let (size, n_times) = (batch.size, batch.n_times);
        let latent_dim = self.network.latent_dim;
        let views = Tensor::from_slice(&batch.views, size, &self.device)?;
        let inputs = self.network.encoder_inputs(self.hand.dof());
        let motions = self.constant(
            batch.motions.clone(),
            &[size, self.network.encoder_steps, inputs],
        )?;
        let (mean, log_variance) = tape.encode(&motions, features, &views)?;
        // A code that is given costs no divergence, and has no noise.
        let is_encoded = self.constant(batch.is_encoded.clone(), &[size, 1])?;
        let given = self.constant(batch.codes.clone(), &[size, latent_dim])?;
        let mean = mean.broadcast_mul(&is_encoded)?;
        let log_variance = log_variance.broadcast_mul(&is_encoded)?;
        let centers = (&mean + given)?;
        let mut codes = Codes {
            of_motions: centers,
            of_times: None,
        };
        if !batch.noise.is_empty() {
            let deviation = (&log_variance * 0.5)?.exp()?.broadcast_mul(&is_encoded)?;
            let noise = |rows: usize| self.constant(batch.noise.clone(), &[rows, latent_dim]);
            match self.training.latent_noise {
                LatentNoise::PerMotion => {
                    codes.of_motions = (codes.of_motions + (deviation * noise(size)?)?)?;
                }
                LatentNoise::PerTime => {
                    let noise = (per_time(&deviation, n_times)? * noise(size * n_times)?)?;
                    codes.of_times = Some((per_time(&codes.of_motions, n_times)? + noise)?);
                }
            }
        }
        Ok((codes, [mean, log_variance]))
    }

    /// Decodes the codes of a batch's motions.
    pub(crate) fn decoded(
        &self,
        batch: &Batch,
        normalization: &Normalization,
        tape: &Network,
        features: &Tensor,
        codes: &Codes,
    ) -> Result<Decoded, CgfError> {
        let (size, n_times) = (batch.size, batch.n_times);
        let views = Tensor::from_slice(&batch.views, size, &self.device)?;
        let times = self.constant(batch.times.clone(), &[size, n_times])?;
        let decode = |part: Curve, seen: Option<&Tensor>| {
            let with = |codes: &Tensor, seen: Option<Tensor>| match seen {
                Some(seen) => Ok::<_, CgfError>(Tensor::cat(&[codes, &seen], 1)?),
                None => Ok(codes.clone()),
            };
            let Some(of_times) = &codes.of_times else {
                let codes = with(&codes.of_motions, seen.cloned())?;
                return tape.curve(part, &times, &codes, features, &views);
            };
            let repeated = views.unsqueeze(1)?.broadcast_as((size, n_times))?;
            let views = repeated.flatten_all()?;
            let times = times.reshape((size * n_times, 1))?;
            let seen = seen.map(|seen| per_time(seen, n_times)).transpose()?;
            tape.curve(part, &times, &with(of_times, seen)?, features, &views)
        };
        let Some(units) = &self.local_normalization else {
            let rows = decode(Curve::Decoder, None)?;
            let (rows, physical) = self.within_limits(rows, normalization)?;
            return Ok(Decoded {
                rows,
                physical,
                coarse: Tensor::zeros((), DType::F32, &self.device)?,
            });
        };
        let codes = &codes.of_motions;
        let (grasps, coarse) = self.grasps(batch, normalization, tape, features, codes)?;
        let points = leaf(tape.leaves, basis_points::NAME)?.flatten_all()?;
        let points = points.to_vec1::<f32>()?;
        let seen = grasps.par_iter().zip(&batch.views);
        let seen = seen.map(|(grasp, &view)| batch.local[view as usize].code(&points, grasp));
        let seen = seen.collect::<Vec<_>>().concat();
        let width = seen.len() / size;
        let seen = self.constant(seen, &[size, width])?;
        let rows = decode(Curve::Local, Some(&seen))?;
        let physical = from_grasps(&self.physical(&rows, units)?, &grasps, n_times)?;
        let physical = self.limits.on_tape(&physical)?.unwrap_or(physical);
        let rows = self.normalized(&physical, normalization)?;
        Ok(Decoded {
            rows,
            physical,
            coarse,
        })
    }

    /// Decodes the grasps of codes by the first decoder, moved by the batch's noise, and the squared error of those
    /// without it.
    fn grasps(
        &self,
        batch: &Batch,
        normalization: &Normalization,
        tape: &Network,
        features: &Tensor,
        codes: &Tensor,
    ) -> Result<(Vec<HandState<NetworkFrame>>, Tensor), CgfError> {
        let size = batch.size;
        let outputs = normalization.scale.len();
        let views = Tensor::from_slice(&batch.views, size, &self.device)?;
        let times = Tensor::zeros((size, 1), DType::F32, &self.device)?;
        let rows = tape.curve(Curve::Decoder, &times, codes, features, &views)?;
        let (rows, physical) = self.within_limits(rows, normalization)?;
        let at = self.training.grasp_steps - 1;
        let targets = batch.targets.chunks_exact(outputs);
        let targets = targets.skip(at).step_by(batch.n_times).flatten().copied();
        let targets = self.constant(targets.collect(), &[size, outputs])?;
        let error = (rows - targets)?.sqr()?.mean_all()?;
        let physical = physical.flatten_all()?.to_vec1::<f32>()?;
        let noise_m = self.training.local_noise_m;
        let grasps = basis_points::grasps(&physical, outputs, &batch.local_noise, noise_m)?;
        Ok((grasps, error))
    }

    /// Takes a decoder's outputs to physical units.
    fn physical(&self, rows: &Tensor, units: &Normalization) -> Result<Tensor, CgfError> {
        let [scale, shift] = self.units(units)?;
        Ok(rows.broadcast_mul(&scale)?.broadcast_add(&shift)?)
    }

    /// Takes hands in physical units to the network's.
    fn normalized(&self, physical: &Tensor, units: &Normalization) -> Result<Tensor, CgfError> {
        let [scale, shift] = self.units(units)?;
        Ok(physical.broadcast_sub(&shift)?.broadcast_div(&scale)?)
    }

    fn units(&self, units: &Normalization) -> Result<[Tensor; 2], CgfError> {
        let row = |numbers: &[f64]| self.constant(narrow_all(numbers), &[numbers.len()]);
        Ok([row(&units.scale)?, row(&units.mean)?])
    }

    /// Keeps the joints of decoded hands within their limits, if they are: the hands in the network's
    /// units and in physical ones, `(rows, outputs)` each.
    fn within_limits(
        &self,
        decoded: Tensor,
        units: &Normalization,
    ) -> Result<(Tensor, Tensor), CgfError> {
        let physical = self.physical(&decoded, units)?;
        match self.limits.on_tape(&physical)? {
            None => Ok((decoded, physical)),
            Some(within) => Ok((self.normalized(&within, units)?, within)),
        }
    }
}

/// Takes rows relative to the palms of grasps, in physical units, to the network's frame.
fn from_grasps(
    rows: &Tensor,
    grasps: &[HandState<NetworkFrame>],
    n_times: usize,
) -> Result<Tensor, CgfError> {
    let (size, device) = (grasps.len(), rows.device());
    let joints = rows.narrow(1, PALM_WIDTH, rows.dim(1)? - PALM_WIDTH)?;
    // Three vectors a row, each as a row: v · Rᵀ, and the first of them a position.
    let turns = grasps.iter().flat_map(|grasp| {
        let turn = grasp.frame_from_palm.rotation.to_rotation_matrix();
        turn.matrix().as_slice().to_vec()
    });
    let turns = Tensor::from_vec(turns.map(narrow).collect::<Vec<_>>(), (size, 3, 3), device)?;
    let places = grasps.iter().flat_map(|grasp| {
        let place = <[f64; 3]>::from(grasp.frame_from_palm.translation.vector);
        place.into_iter().chain([0.0; PALM_WIDTH - 3])
    });
    let places = places.map(narrow).collect::<Vec<_>>();
    let places = Tensor::from_vec(places, (size, 1, PALM_WIDTH), device)?;
    let palms = rows
        .narrow(1, 0, PALM_WIDTH)?
        .reshape((size, n_times * 3, 3))?;
    let palms = palms.matmul(&turns)?.reshape((size, n_times, PALM_WIDTH))?;
    let palms = palms.broadcast_add(&places)?;
    let palms = palms.reshape((size * n_times, PALM_WIDTH))?;
    Ok(Tensor::cat(&[&palms, &joints], 1)?)
}
