//! Training: demonstrations in, a grasping function out (section III-C of the paper).

use std::{collections::BTreeMap, sync::Arc};

use candle_core::{Device, Tensor};
use nalgebra::{Point3, UnitQuaternion};
use robot::RobotModel;

use crate::{
    Cgf, CgfError,
    adam::{self, Adam},
    augmentation::Rotations,
    config::{NetworkConfig, TrainingConfig},
    data::{Scene, Track, turned},
    grasp::{Grasp, Normalization, ROOT},
    kinematics::LinkOrigins,
    loss,
    model::{Curve, Description, JointRange, VERSION},
    network::{self, Network, constant},
    point_net::{self, Clouds, PointNet, Statistics},
    precision::{narrow, narrow_all, row_index},
    random::Random,
    weights::Weights,
};

/// Share of the way that stored statistics move towards those of each step.
const MOMENTUM: f32 = 0.1;

/// Motions and the scenes in which they were recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingSet {
    /// Objects as they lay.
    pub scenes: Vec<Scene>,
    /// The motions.
    pub tracks: Vec<Track>,
}

/// The mean losses of one epoch, before they are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Losses {
    /// Weighted sum.
    pub total: f32,
    /// `L_q`, in the units of the network's outputs.
    pub q: f32,
    /// `L_j` in m².
    pub origins: f32,
    /// `L_KL` in nats.
    pub kl: f32,
    /// `L_contact` in m².
    pub contact: f32,
}

/// Trains a grasping function; `progress` hears of every epoch (from 1) and its losses.
///
/// Equal arguments give equal weights on any number of threads.
///
/// # Errors
///
/// Fails if the set or the configuration cannot be used, or if the loss is no longer a number.
pub fn train(
    set: &TrainingSet,
    hand: &Arc<RobotModel>,
    network: &NetworkConfig,
    training: &TrainingConfig,
    seed: u64,
    mut progress: impl FnMut(usize, &Losses),
) -> Result<Cgf, CgfError> {
    let mut trainer = Trainer::new(set, hand, network, training, seed)?;
    let mut curve = Curve::default();
    for epoch in 0..training.epochs {
        let losses = trainer.epoch(epoch)?;
        if !losses.total.is_finite() {
            return Err(CgfError::Diverged {
                epoch: epoch + 1,
                loss: losses.total,
            });
        }
        curve.push(&losses);
        progress(epoch + 1, &losses);
    }
    trainer.finish(curve)
}

struct Trainer<'a> {
    set: &'a TrainingSet,
    hand: &'a Arc<RobotModel>,
    network: &'a NetworkConfig,
    training: &'a TrainingConfig,
    seed: u64,
    surfaces: Vec<Vec<Point3<f64>>>,
    tips: Vec<usize>,
    normalization: Normalization,
    weights: Weights,
    adam: Adam,
    rotations: Rotations,
    random: Random,
    statistics: Statistics,
}

/// What one step of the optimizer sees.
struct Batch {
    size: usize,
    /// The object clouds, one for each scene of the batch, and their surfaces.
    clouds: Arc<Clouds>,
    surfaces: Vec<Vec<Point3<f64>>>,
    /// Which of them each motion has.
    scenes: Vec<u32>,
    /// `(batch, encoder steps, outputs)`, in the network's units.
    motions: Vec<f32>,
    /// `(batch, times)`.
    times: Vec<f32>,
    /// `(batch × times, outputs)`, in physical units and the network's.
    physical: Vec<f32>,
    targets: Vec<f32>,
    /// `(batch, latent)` from the standard normal distribution.
    noise: Vec<f32>,
}

impl<'a> Trainer<'a> {
    fn new(
        set: &'a TrainingSet,
        hand: &'a Arc<RobotModel>,
        network: &'a NetworkConfig,
        training: &'a TrainingConfig,
        seed: u64,
    ) -> Result<Self, CgfError> {
        network.check()?;
        training.check()?;
        if set.tracks.len() < 2 {
            return Err(CgfError::TooFewTrajectories {
                found: set.tracks.len(),
            });
        }
        for track in &set.tracks {
            track.check(hand.dof())?;
            assert!(track.scene < set.scenes.len(), "scene of `{}`", track.name);
        }
        let tips = training
            .tips
            .iter()
            .map(|tip| {
                hand.link(tip)
                    .ok_or_else(|| CgfError::UnknownLink { link: tip.clone() })
            })
            .collect::<Result<_, _>>()?;
        let rotations = Rotations::new(training.augmentation, set.scenes.len(), seed);
        let mut random = Random::new(seed, 1);
        let mut samples = Vec::new();
        for track in &set.tracks {
            for _ in 0..if rotations.turns() { 4 } else { 1 } {
                let rotation = rotations.draw(track.scene, &mut random);
                let times = (0..=20).map(|k| f64::from(k) / 20.0);
                samples.extend(times.map(|t| turned(&track.at(t), &rotation).to_numbers()));
            }
        }
        let mut trainer = Self {
            set,
            hand,
            network,
            training,
            seed,
            surfaces: set.scenes.iter().map(Scene::points_in_table).collect(),
            tips,
            normalization: Normalization::measure(training.outputs, &samples),
            weights: network::initialize(network, ROOT + hand.dof(), seed),
            adam: Adam::default(),
            rotations,
            random,
            statistics: Statistics::Measured,
        };
        trainer.center_features()?;
        Ok(trainer)
    }

    /// Shifts the point network's last layer so that the features start with mean 0 over the scenes:
    /// maxima of normal numbers are all positive, and what they share would drown what they tell apart.
    fn center_features(&mut self) -> Result<(), CgfError> {
        let net = PointNet::new(&self.weights, self.network.point_widths.len())?;
        let features = net
            .forward(&self.all_clouds()?, Statistics::Measured)
            .features;
        let width = features.len() / self.set.scenes.len();
        let mut shift = vec![0.0; width];
        for feature in features.chunks_exact(width) {
            for (shift, x) in shift.iter_mut().zip(feature) {
                *shift -= x / self.set.scenes.len() as f32;
            }
        }
        let name = format!("point_net.{}.shift", self.network.point_widths.len() - 1);
        self.weights.set(&name, &[width], shift);
        Ok(())
    }

    fn all_clouds(&mut self) -> Result<Clouds, CgfError> {
        let points = self.network.points;
        let mut clouds = Clouds {
            points,
            xyz: Vec::new(),
        };
        for (number, scene) in self.set.scenes.iter().enumerate() {
            let rotation = self.rotations.draw(number, &mut self.random);
            clouds.xyz.extend(scene.cloud(points, &rotation)?.xyz);
        }
        Ok(clouds)
    }

    fn epoch(&mut self, epoch: usize) -> Result<Losses, CgfError> {
        let share = epoch as f64 / self.training.epochs as f64;
        if self.statistics == Statistics::Measured && share >= self.training.fixed_statistics_after
        {
            self.fix_statistics()?;
        }
        let order = self.random.permutation(self.set.tracks.len());
        let mut sum = Losses::default();
        for tracks in equal_chunks(&order, self.training.batch) {
            let batch = self.batch(tracks)?;
            let losses = self.step(&batch, self.training.learning_rate_of(epoch))?;
            sum.add(&losses, tracks.len() as f32 / order.len() as f32);
            if !losses.total.is_finite() {
                break;
            }
        }
        Ok(sum)
    }

    /// Measures the point network's statistics over all scenes, once and for all.
    fn fix_statistics(&mut self) -> Result<(), CgfError> {
        let net = PointNet::new(&self.weights, self.network.point_widths.len())?;
        let pass = net.forward(&self.all_clouds()?, Statistics::Measured);
        pass.store(1.0, &mut self.weights)?;
        self.statistics = Statistics::Stored;
        Ok(())
    }

    fn batch(&mut self, tracks: &[usize]) -> Result<Batch, CgfError> {
        let (set, training) = (self.set, self.training);
        let mut used: Vec<usize> = tracks
            .iter()
            .map(|&track| set.tracks[track].scene)
            .collect();
        used.sort_unstable();
        used.dedup();
        let points = self.network.points;
        let mut batch = Batch {
            size: tracks.len(),
            clouds: Arc::default(),
            surfaces: Vec::new(),
            scenes: Vec::new(),
            motions: Vec::new(),
            times: Vec::new(),
            physical: Vec::new(),
            targets: Vec::new(),
            noise: Vec::new(),
        };
        let mut clouds = Clouds {
            points,
            xyz: Vec::new(),
        };
        let mut rotations = Vec::with_capacity(used.len());
        for &scene in &used {
            let rotation = self.rotations.draw(scene, &mut self.random);
            clouds
                .xyz
                .extend(set.scenes[scene].cloud(points, &rotation)?.xyz);
            let surface = self.surfaces[scene].iter();
            batch
                .surfaces
                .push(surface.map(|point| rotation * point).collect());
            rotations.push(rotation);
        }
        batch.clouds = Arc::new(clouds);
        for &track in tracks {
            let track = &set.tracks[track];
            let scene = used.partition_point(|&scene| scene < track.scene);
            let rotation = &rotations[scene];
            batch.scenes.push(row_index(scene));
            let motion = encoder_motion(
                track,
                self.network.encoder_steps,
                rotation,
                &self.normalization,
            );
            batch.motions.extend(motion);
            let mut times = track.last_times(training.grasp_steps);
            times.extend((0..training.random_times).map(|_| self.random.uniform()));
            for t in times {
                let numbers = turned(&track.at(t), rotation).to_numbers();
                batch.times.push(narrow(t));
                batch.targets.extend(self.normalization.normalize(&numbers));
                batch.physical.extend(numbers.into_iter().map(narrow));
            }
            // One draw for the whole motion.
            batch
                .noise
                .extend((0..self.network.latent_dim).map(|_| narrow(self.random.normal())));
        }
        Ok(batch)
    }

    fn step(&mut self, batch: &Batch, learning_rate: f64) -> Result<Losses, CgfError> {
        let leaves = self.weights.variables(&Device::Cpu)?;
        let (features, measured) = point_net::features(
            &leaves,
            self.network.point_widths.len(),
            &batch.clouds,
            self.statistics,
        )?;
        let tape = Network {
            config: self.network,
            leaves: &leaves,
        };
        let (total, losses) = self.losses(batch, &tape, &features)?;
        if !losses.total.is_finite() {
            return Ok(losses);
        }
        let by = total.backward()?;
        let mut gradients = BTreeMap::new();
        for (name, leaf) in &leaves {
            if let Some(gradient) = by.get(leaf) {
                gradients.insert(name.clone(), gradient.flatten_all()?.to_vec1()?);
            }
        }
        if let Some(max_norm) = self.training.max_gradient_norm {
            adam::shorten(&mut gradients, max_norm);
        }
        self.adam.step(&mut self.weights, &gradients, learning_rate);
        if self.statistics == Statistics::Measured {
            point_net::store(&measured, MOMENTUM, &mut self.weights)?;
        }
        Ok(losses)
    }

    fn losses(
        &self,
        batch: &Batch,
        tape: &Network,
        features: &Tensor,
    ) -> Result<(Tensor, Losses), CgfError> {
        let training = self.training;
        let outputs = ROOT + self.hand.dof();
        let n_times = training.grasp_steps + training.random_times;
        let rows = batch.size * n_times;
        let scenes = Tensor::from_slice(&batch.scenes, batch.size, &candle_core::Device::Cpu)?;
        let motions = constant(
            batch.motions.clone(),
            &[batch.size, self.network.encoder_steps, outputs],
        )?;
        let (mean, log_variance) = tape.encode(&motions, features, &scenes)?;
        let noise = constant(batch.noise.clone(), &[batch.size, self.network.latent_dim])?;
        let latents = (&mean + ((&log_variance * 0.5)?.exp()? * noise)?)?;
        let times = constant(batch.times.clone(), &[batch.size, n_times])?;
        let decoded = tape.decode(&times, &latents, features, &scenes)?;
        let targets = constant(batch.targets.clone(), &[rows, outputs])?;
        let row_weights = loss::row_weights(
            batch.size,
            training.grasp_steps,
            training.random_times,
            training.grasp_weight,
        )?;
        let q = loss::squared_error(&decoded, &targets, &row_weights)?;
        let scale = constant(narrow_all(&self.normalization.scale), &[outputs])?;
        let shift = constant(narrow_all(&self.normalization.mean), &[outputs])?;
        let physical = decoded.broadcast_mul(&scale)?.broadcast_add(&shift)?;
        let fk = LinkOrigins::new(self.hand.clone());
        let wanted = constant(batch.physical.clone(), &[rows, outputs])?.apply_op1_no_bwd(&fk)?;
        let reached = physical.apply_op1(fk)?;
        let origins = loss::squared_distance(&reached, &wanted, &row_weights)?;
        let kl = loss::kl_divergence(&mean, &log_variance)?;
        let (tips, surfaces) = self.tips_at_grasp(batch, &reached)?;
        let contact = loss::contact(&tips, &surfaces, training.contact, training.tip_radius_m)?;
        let motion = ((&q * training.q_weight)? + (&origins * training.origins_weight)?)?;
        let code = (&kl * training.kl_weight)?;
        let total = ((motion + code)? + (&contact * training.contact_weight)?)?;
        let number = |loss: &Tensor| loss.to_scalar::<f32>();
        let losses = Losses {
            total: number(&total)?,
            q: number(&q)?,
            origins: number(&origins)?,
            kl: number(&kl)?,
            contact: number(&contact)?,
        };
        Ok((total, losses))
    }

    /// Picks the finger tips at t = 0, the last of the grasp's steps, and the surface that each of them
    /// is to touch.
    fn tips_at_grasp<'b>(
        &self,
        batch: &'b Batch,
        origins: &Tensor,
    ) -> Result<(Tensor, Surfaces<'b>), CgfError> {
        let n_links = self.hand.links().len();
        let n_times = self.training.grasp_steps + self.training.random_times;
        let mut rows = Vec::with_capacity(batch.size * self.tips.len());
        let mut surfaces = Vec::with_capacity(rows.capacity());
        for (motion, &scene) in batch.scenes.iter().enumerate() {
            let row = motion * n_times + self.training.grasp_steps - 1;
            for tip in &self.tips {
                rows.push(row_index(row * n_links + tip));
                surfaces.push(batch.surfaces[scene as usize].as_slice());
            }
        }
        let rows = Tensor::new(rows, &candle_core::Device::Cpu)?;
        let tips = origins.reshape(((), 3))?.index_select(&rows, 0)?;
        Ok((tips, surfaces))
    }

    fn finish(self, curve: Curve) -> Result<Cgf, CgfError> {
        let description = Description {
            version: VERSION.to_owned(),
            joints: self.hand.joint_names(),
            joint_ranges: self.hand.joints().iter().map(JointRange::of).collect(),
            network: self.network.clone(),
            training: self.training.clone(),
            seed: self.seed,
            normalization: self.normalization,
            demonstrations: Vec::new(),
            training_curve: curve,
        };
        let mut cgf = Cgf::new(description, self.weights)?;
        cgf.learn_posteriors(self.set)?;
        Ok(cgf)
    }
}

/// For each finger tip, the points of the surface that it is to touch.
type Surfaces<'b> = Vec<&'b [Point3<f64>]>;

impl Losses {
    fn add(&mut self, other: &Self, share: f32) {
        self.total += share * other.total;
        self.q += share * other.q;
        self.origins += share * other.origins;
        self.kl += share * other.kl;
        self.contact += share * other.contact;
    }
}

/// Returns what the encoder sees of a motion: steps at equal times from 1 to 0, in the network's units.
pub(crate) fn encoder_motion(
    track: &Track,
    steps: usize,
    rotation: &UnitQuaternion<f64>,
    normalization: &Normalization,
) -> Vec<f32> {
    equal_times(steps)
        .flat_map(|t| {
            let grasp: Grasp = turned(&track.at(t), rotation);
            normalization.normalize(&grasp.to_numbers())
        })
        .collect()
}

/// Returns `n` times from 1 (far) to 0 (the grasp).
pub(crate) fn equal_times(n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |k| (n - 1 - k) as f64 / (n.max(2) - 1) as f64)
}

/// Cuts into as few chunks of at most `longest` as possible, of equal length but for one.
fn equal_chunks(order: &[usize], longest: usize) -> Vec<&[usize]> {
    let n = order.len().div_ceil(longest);
    let cut = |k: usize| k * order.len() / n;
    (0..n).map(|k| &order[cut(k)..cut(k + 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::equal_chunks;

    #[test]
    fn no_batch_is_much_smaller_than_another() {
        let check = |n: usize, longest: usize, expected: &[usize]| {
            let order: Vec<usize> = (0..n).collect();
            let chunks = equal_chunks(&order, longest);
            let lengths: Vec<usize> = chunks.iter().map(|chunk| chunk.len()).collect();
            assert_eq!(lengths, expected);
            assert_eq!(chunks.concat(), order);
        };
        check(9, 8, &[4, 5]);
        check(8, 8, &[8]);
        check(3, 32, &[3]);
        check(10, 4, &[3, 3, 4]);
    }
}
