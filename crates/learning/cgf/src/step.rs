//! One step of training: from a batch to its losses and their gradients (section III-C of the paper).

use std::{collections::BTreeMap, sync::Arc};

use candle_core::{Device, Tensor};
use nalgebra::Point3;
use robot::RobotModel;
use serde::{Deserialize, Serialize};

use crate::{
    CgfError,
    batch::Batch,
    config::{Contact, NetworkConfig, Reduction, TrainingConfig},
    decoded::Decoded,
    hand_numbers::{Normalization, PALM_WIDTH},
    kinematics::{LinkParts, LinkPoses},
    limits::Limits,
    loss,
    network::{Curve, Network, constant},
    penetration::Body,
    point_net::{self, Measured, PointNet, Statistics},
    precision::row_index,
    weights::Weights,
};

/// Mean losses over motions, before they are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Losses {
    /// Weighted sum of the others but `prior`.
    pub total: f32,
    /// `L_q`, in the units of the network's outputs.
    pub q: f32,
    /// The part of `L_q` that is the translation's, in the same units.
    pub translation: f32,
    /// `L_j` in m².
    pub origins: f32,
    /// Squared errors of two columns of the links' rotations; 0 if they have no weight.
    pub rotations: f32,
    /// `L_KL` in nats.
    pub kl: f32,
    /// `L_contact` in m².
    pub contact: f32,
    /// Squared depths of the links in object and table, in m²; 0 if they have no weight.
    pub penetration: f32,
    /// Squared error of the first decoder's grasp, in the units of the network's outputs; 0 without a second one.
    #[serde(default)]
    pub coarse: f32,
    /// Squared error of the flow's velocity, which only the flow learns from; 0 without one, and in measuring.
    #[serde(default)]
    pub prior: f32,
}

/// Training objective: the weighted sum of the losses.
pub(crate) struct Objective<'a> {
    pub(crate) hand: &'a Arc<RobotModel>,
    pub(crate) network: &'a NetworkConfig,
    pub(crate) training: &'a TrainingConfig,
    /// Links whose origins are the fingertips.
    pub(crate) tips: Vec<usize>,
    /// The room that the hand takes up, if it is kept out of object and table.
    pub(crate) body: Option<Body>,
    /// Map from the decoder's numbers to joint positions.
    pub(crate) limits: Limits,
    /// Units of the second decoder, if there is one.
    pub(crate) local_normalization: Option<Normalization>,
    /// Device on which it is computed.
    pub(crate) device: Device,
}

/// Gradients by the names of the arrays.
pub(crate) type Gradients = BTreeMap<String, Vec<f32>>;

/// For each fingertip, the points of the surface that it is to touch.
type Surfaces<'b> = Vec<&'b [Point3<f64>]>;

impl Objective<'_> {
    /// Computes a batch's losses and, if they are finite, their gradients, and the statistics that the
    /// point network measured.
    pub(crate) fn gradients(
        &self,
        weights: &Weights,
        normalization: &Normalization,
        batch: &Batch,
        statistics: Statistics,
    ) -> Result<(Losses, Gradients, Measured), CgfError> {
        let leaves = weights.variables(&self.device)?;
        let n_layers = self.network.point_widths.len();
        let (features, measured) =
            point_net::features(&leaves, n_layers, &batch.clouds, statistics)?;
        let tape = Network {
            config: self.network,
            leaves: &leaves,
        };
        let (total, losses) = self.losses(batch, normalization, &tape, &features)?;
        let mut gradients = Gradients::new();
        if losses.is_finite() {
            let by = total.backward()?;
            for (name, leaf) in &leaves {
                if let Some(gradient) = by.get(leaf) {
                    gradients.insert(name.clone(), gradient.flatten_all()?.to_vec1()?);
                }
            }
        }
        Ok((losses, gradients, measured))
    }

    /// Computes a batch's losses with the stored statistics.
    pub(crate) fn measure(
        &self,
        weights: &Weights,
        normalization: &Normalization,
        batch: &Batch,
    ) -> Result<Losses, CgfError> {
        let net = PointNet::new(weights, self.network.point_widths.len())?;
        let features = net.forward(&batch.clouds, Statistics::Stored).features;
        let n_views = batch.surfaces.len();
        let width = features.len() / n_views;
        let features = self.constant(features, &[n_views, width])?;
        let tape = Network {
            config: self.network,
            leaves: &weights.constants_on(&self.device)?,
        };
        Ok(self.losses(batch, normalization, &tape, &features)?.1)
    }

    pub(crate) fn constant(&self, values: Vec<f32>, shape: &[usize]) -> Result<Tensor, CgfError> {
        Ok(Tensor::from_vec(values, shape, &self.device)?)
    }

    fn losses(
        &self,
        batch: &Batch,
        normalization: &Normalization,
        tape: &Network,
        features: &Tensor,
    ) -> Result<(Tensor, Losses), CgfError> {
        let training = self.training;
        let outputs = PALM_WIDTH + self.hand.dof();
        let rows = batch.size * batch.n_times;
        let (codes, [mean, log_variance]) = self.encoded(batch, tape, features)?;
        let Decoded {
            rows: decoded,
            physical,
            coarse,
        } = self.decoded(batch, normalization, tape, features, &codes)?;
        let targets = self.constant(batch.targets.clone(), &[rows, outputs])?;
        let row_weights = loss::row_weights(
            batch.size,
            training.grasp_steps,
            training.random_times,
            training.grasp_weight,
        )?
        .to_device(&self.device)?;
        let q = loss::squared_error(&decoded, &targets, &row_weights)?;
        let translation = loss::squared_error(
            &decoded.narrow(1, 0, 3)?,
            &targets.narrow(1, 0, 3)?,
            &row_weights,
        )?;
        // Kinematics are the host's.
        let physical = physical.to_device(&Device::Cpu)?;
        let [reached, wanted] = self.link_poses(&physical, batch)?;
        let origins = loss::squared_distance(&reached.origins, &wanted.origins, &row_weights)?;
        let rotations = match (&reached.columns, &wanted.columns) {
            (Some(reached), Some(wanted)) => loss::squared_error(reached, wanted, &row_weights)?,
            _ => Tensor::zeros((), candle_core::DType::F32, &self.device)?,
        };
        let kl = loss::kl_divergence(&mean, &log_variance)?;
        let contact = self.contact(batch, &reached, &wanted)?;
        let penetration = self.penetration(&physical, batch, &row_weights)?;
        // A sum is a mean of so many more.
        let count = |n: usize| match training.reduction {
            Reduction::Mean => 1.0,
            Reduction::Sum => n as f64,
        };
        let (n_times, n_links) = (batch.n_times, self.hand.links().len());
        let terms = [
            ((q * count(n_times * outputs))?, training.q_weight),
            (
                (translation * count(n_times * 3))?,
                training.translation_weight,
            ),
            (
                (origins * count(n_times * n_links))?,
                training.origins_weight,
            ),
            (
                (rotations * count(n_times * n_links * 6))?,
                training.rotations_weight,
            ),
            (kl, training.kl_weight),
            ((contact * count(self.tips.len()))?, training.contact_weight),
            (
                (penetration * count(n_times * n_links))?,
                training.penetration_weight,
            ),
            (coarse, training.q_weight),
        ];
        let (mut total, mut losses) = self.weighted_sum(&terms)?;
        if let Some(prior) = self.prior(batch, tape, &codes.of_motions, features)? {
            losses.prior = prior.to_scalar()?;
            total = (total + prior)?;
        }
        Ok((total, losses))
    }

    /// Computes the link poses of the decoded hands, given in physical units, and of the recorded ones.
    fn link_poses(&self, physical: &Tensor, batch: &Batch) -> Result<[LinkTensors; 2], CgfError> {
        let outputs = PALM_WIDTH + self.hand.dof();
        let rows = batch.size * batch.n_times;
        let parts = if self.training.rotations_weight > 0.0 {
            LinkParts::OriginsAndColumns
        } else {
            LinkParts::Origins
        };
        let fk = LinkPoses::new(self.hand.clone(), parts);
        let wanted = constant(batch.physical.clone(), &[rows, outputs])?
            .apply_op1_no_bwd(&fk)?
            .to_device(&self.device)?;
        let reached = physical.apply_op1(fk)?.to_device(&self.device)?;
        Ok([split(&reached, parts, rows)?, split(&wanted, parts, rows)?])
    }

    /// Sums terms by their weights, in the order of the fields of [`Losses`] after the total; a term
    /// without a weight is measured only.
    fn weighted_sum(&self, terms: &[(Tensor, f64); 8]) -> Result<(Tensor, Losses), CgfError> {
        let mut total = Tensor::zeros((), candle_core::DType::F32, &self.device)?;
        let mut numbers = [0.0; 8];
        for ((term, weight), number) in terms.iter().zip(&mut numbers) {
            *number = term.to_scalar::<f32>()?;
            if *weight > 0.0 {
                total = (total + (term * *weight)?)?;
            }
        }
        let [
            q,
            translation,
            origins,
            rotations,
            kl,
            contact,
            penetration,
            coarse,
        ] = numbers;
        let losses = Losses {
            total: total.to_scalar()?,
            q,
            translation,
            origins,
            rotations,
            kl,
            contact,
            penetration,
            coarse,
            prior: 0.0,
        };
        Ok((total, losses))
    }

    /// Computes the flow's loss, if there is a flow: the squared error of its velocity on the line from a number of the
    /// standard normal distribution to a motion's code (Lipman et al., *Flow Matching for Generative Modeling*, 2023,
    /// section 4.1). Codes and features are constants of it: it moves no other weights.
    fn prior(
        &self,
        batch: &Batch,
        tape: &Network,
        codes: &Tensor,
        features: &Tensor,
    ) -> Result<Option<Tensor>, CgfError> {
        if batch.flow_times.is_empty() {
            return Ok(None);
        }
        let shape = [batch.size, self.network.latent_dim];
        let views = Tensor::from_slice(&batch.views, batch.size, &self.device)?;
        let from = self.constant(batch.flow_noise.clone(), &shape)?;
        let times = self.constant(batch.flow_times.clone(), &[batch.size, 1])?;
        let wanted = (codes.detach() - &from)?;
        let between = (from + wanted.broadcast_mul(&times)?)?;
        let found = tape.curve(Curve::Flow, &times, &between, &features.detach(), &views)?;
        Ok(Some((found - wanted)?.sqr()?.mean_all()?))
    }

    /// Computes the contact loss of hands, given their links and those of the recorded ones, in m².
    fn contact(
        &self,
        batch: &Batch,
        reached: &LinkTensors,
        wanted: &LinkTensors,
    ) -> Result<Tensor, CgfError> {
        let tips_of = match self.training.contact {
            Contact::TouchCenter | Contact::TouchSurface => &reached.origins,
            Contact::Demonstrated => &wanted.origins,
        };
        let (tips, surfaces) = self.tips_at_grasp(batch, tips_of)?;
        let (contact, radius_m) = (self.training.contact, self.training.tip_radius_m);
        loss::contact(&tips, &surfaces, contact, radius_m)
    }

    /// Computes the penetration loss of hands in object and table: the weighted mean of squared depths
    /// over rows and links, in m².
    fn penetration(
        &self,
        physical: &Tensor,
        batch: &Batch,
        row_weights: &Tensor,
    ) -> Result<Tensor, CgfError> {
        let Some(body) = &self.body else {
            return Ok(Tensor::zeros((), candle_core::DType::F32, &self.device)?);
        };
        let depths = body.penetration(physical, &batch.surroundings)?;
        Ok((depths.to_device(&self.device)? * row_weights)?.sum_all()?)
    }

    /// Picks the fingertips at t = 0, the last of the grasp's steps, and the surface that each of them
    /// is to touch.
    fn tips_at_grasp<'b>(
        &self,
        batch: &'b Batch,
        origins: &Tensor,
    ) -> Result<(Tensor, Surfaces<'b>), CgfError> {
        let n_links = self.hand.links().len();
        let mut rows = Vec::with_capacity(batch.size * self.tips.len());
        let mut surfaces = Vec::with_capacity(rows.capacity());
        for (motion, &view) in batch.views.iter().enumerate() {
            let row = motion * batch.n_times + self.training.grasp_steps - 1;
            for tip in &self.tips {
                rows.push(row_index(row * n_links + tip));
                surfaces.push(batch.surfaces[view as usize].as_slice());
            }
        }
        let rows = Tensor::new(rows, &self.device)?;
        let tips = origins.reshape(((), 3))?.index_select(&rows, 0)?;
        Ok((tips, surfaces))
    }
}

/// Poses of the links: origins `(rows, 3 links)` and rotation columns `(rows, 6 links)`.
struct LinkTensors {
    origins: Tensor,
    columns: Option<Tensor>,
}

fn split(poses: &Tensor, parts: LinkParts, rows: usize) -> Result<LinkTensors, CgfError> {
    Ok(match parts {
        LinkParts::Origins => LinkTensors {
            origins: poses.clone(),
            columns: None,
        },
        LinkParts::OriginsAndColumns => {
            let poses = poses.reshape(((), parts.width()))?;
            let part = |from: usize, n: usize| poses.narrow(1, from, n)?.reshape((rows, ()));
            LinkTensors {
                origins: part(0, 3)?,
                columns: Some(part(3, 6)?),
            }
        }
    })
}

impl Losses {
    /// Says whether all that is learned from is a number.
    pub(crate) fn is_finite(&self) -> bool {
        self.total.is_finite() && self.prior.is_finite()
    }

    /// Adds a share of others.
    pub(crate) fn add(&mut self, other: &Self, share: f32) {
        let Self {
            total,
            q,
            translation,
            origins,
            rotations,
            kl,
            contact,
            penetration,
            coarse,
            prior,
        } = other;
        self.total += share * total;
        self.q += share * q;
        self.translation += share * translation;
        self.origins += share * origins;
        self.rotations += share * rotations;
        self.kl += share * kl;
        self.contact += share * contact;
        self.penetration += share * penetration;
        self.coarse += share * coarse;
        self.prior += share * prior;
    }
}
