//! Training: demonstrations in, a grasping function out (section III-C of the paper).

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use geometry::DistanceField;
use options::Options;
use robot::RobotModel;
use schemas::{checkpoint::VERSION, training::Split};

use crate::{
    Cgf, CgfError,
    adam::{self, Adam},
    augmentation::Rotations,
    basis_points,
    batch::{Batches, NetworkMotions},
    config::{Initialization, NetworkConfig, TrainingConfig},
    curve::Epoch,
    data::{RestingObject, TrainingMotion, turned},
    decoder::check_width,
    hand_numbers::{self, Normalization},
    limits::{JointRange, Limits},
    model::Description,
    network,
    penetration::Body,
    point_net::{self, PointNet, Statistics},
    random::Random,
    step::{Losses, Objective},
    weights::Weights,
};

/// Share of the way that stored statistics move towards those of each step.
const MOMENTUM: f32 = 0.1;
/// Times the first epoch's loss at which training has diverged.
const DIVERGED: f32 = 100.0;
/// Streams of random numbers: one for the draws before the first epoch, and that of the first epoch.
/// Each epoch has its own, so that a training can resume.
const BEFORE: u64 = 1;
const FIRST_EPOCH: u64 = 1 << 32;

/// Motions and the scenes in which they were recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingSet {
    /// Objects in their resting poses.
    pub scenes: Vec<RestingObject>,
    /// The motions, those that are learned from and those that are kept back.
    pub tracks: Vec<TrainingMotion>,
    /// Distances to the surfaces of the objects, in the object frame, by the objects' names: of all of
    /// them if the training keeps the hand out of them, and otherwise of any.
    pub distances: BTreeMap<String, Arc<DistanceField>>,
}

/// Result of a training.
#[derive(Debug, Clone)]
pub struct TrainingResult {
    /// After the epoch with the least loss on held-out motions; the last one if none is held out.
    pub best: Cgf,
    /// After the last epoch.
    pub last: Cgf,
}

/// A training under way, epoch after epoch.
pub struct Trainer<'a> {
    set: &'a TrainingSet,
    batches: Batches<'a>,
    objective: Objective<'a>,
    training_tracks: Vec<usize>,
    pub(crate) weights: Weights,
    pub(crate) adam: Adam,
    pub(crate) statistics: Statistics,
    pub(crate) curve: Vec<Epoch>,
    pub(crate) best: Option<Best>,
    /// The objects that the function knew from which it goes on, if it does.
    known_before: Option<&'a BTreeSet<String>>,
}

/// The weights with the least loss on held-out motions so far.
pub(crate) struct Best {
    pub(crate) epoch: usize,
    pub(crate) total: f32,
    pub(crate) weights: Weights,
}

/// Trains a grasping function; `progress` is called after every epoch.
///
/// Equal arguments give equal weights on any number of threads.
///
/// # Errors
///
/// Fails if the set or the configuration cannot be used, or if training diverges.
///
/// # Panics
///
/// If a motion names a scene that the set does not have.
pub fn train(
    set: &TrainingSet,
    hand: &Arc<RobotModel>,
    network: &NetworkConfig,
    training: &TrainingConfig,
    seed: u64,
    mut progress: impl FnMut(&Epoch),
) -> Result<TrainingResult, CgfError> {
    let mut trainer = Trainer::new(set, hand, network, training, seed)?;
    while !trainer.is_done() {
        progress(trainer.train_epoch()?);
    }
    trainer.finish()
}

impl<'a> Trainer<'a> {
    /// Starts a training.
    ///
    /// # Errors
    ///
    /// Fails if the set or the configuration cannot be used.
    ///
    /// # Panics
    ///
    /// If a motion names a scene that the set does not have.
    pub fn new(
        set: &'a TrainingSet,
        hand: &'a Arc<RobotModel>,
        network: &'a NetworkConfig,
        training: &'a TrainingConfig,
        seed: u64,
    ) -> Result<Self, CgfError> {
        network.check()?;
        training.check()?;
        training.check_memory(network)?;
        check(set, hand, network)?;
        let tips = tips(hand, training)?;
        let motions = NetworkMotions::of(set, network, training, seed)?;
        let training_tracks = motions.of_split(Split::Training);
        if training_tracks.len() < 2 {
            return Err(CgfError::TooFewTrajectories {
                found: training_tracks.len(),
            });
        }
        let body = if training.penetration_weight > 0.0 {
            Some(body(set, hand)?)
        } else {
            None
        };
        let rotations = Rotations::new(training.augmentation, motions.tracks.len(), seed);
        let mut random = Random::new(seed, BEFORE);
        let samples = samples(&motions, &training_tracks, &rotations, &mut random);
        let initialization = training.initialization;
        let mut weights = network::initialize(network, hand.dof(), initialization, seed);
        let learned = training_tracks
            .iter()
            .map(|&idx| &motions.tracks[idx].track);
        let local_normalization = (network.local_points > 0).then(|| {
            basis_points::choose(&mut weights, network.local_points, hand, learned.clone());
            Normalization::measure(training.outputs, &basis_points::samples(learned))
        });
        let mut trainer = Self {
            set,
            batches: Batches {
                network,
                training,
                seed,
                seen: motions,
                normalization: Normalization::measure(training.outputs, &samples),
                rotations,
            },
            objective: Objective {
                hand,
                network,
                training,
                tips,
                body,
                limits: Limits::new(network.joints, &ranges(hand)),
                local_normalization,
                device: training.device.open()?,
            },
            training_tracks,
            weights,
            adam: Adam::default(),
            statistics: Statistics::Measured,
            curve: Vec::new(),
            best: None,
            known_before: None,
        };
        if initialization == Initialization::Centered {
            trainer.center_features(&mut random)?;
        }
        Ok(trainer)
    }

    /// Goes on from a function of the same hand and network: with its weights, units and statistics.
    ///
    /// # Errors
    ///
    /// Fails if it is of another hand or network.
    pub fn continue_from(&mut self, cgf: &'a Cgf) -> Result<(), CgfError> {
        cgf.check_hand(&self.objective.hand.joint_names())?;
        let description = cgf.description();
        if description.network != *self.batches.network {
            return Err(CgfError::AnotherNetwork);
        }
        self.weights = cgf.weights().clone();
        self.batches.normalization = description.normalization.clone();
        let local = &description.local_normalization;
        self.objective.local_normalization.clone_from(local);
        self.statistics = Statistics::Stored;
        self.known_before = Some(&description.objects);
        Ok(())
    }

    /// Returns the epochs that are done.
    pub fn curve(&self) -> &[Epoch] {
        &self.curve
    }

    /// Says whether all epochs are done.
    pub fn is_done(&self) -> bool {
        self.curve.len() >= self.config().epochs
    }

    pub(crate) fn config(&self) -> &TrainingConfig {
        self.batches.training
    }

    /// Says whether an epoch, counted from 0, leaves the point network's statistics as they are.
    pub(crate) fn is_fixed_in(&self, epoch: usize) -> bool {
        let share = epoch as f64 / self.config().epochs as f64;
        self.known_before.is_some() || share >= self.config().fixed_statistics_after
    }

    /// Starts with features of mean 0 over the objects.
    fn center_features(&mut self, random: &mut Random) -> Result<(), CgfError> {
        let n_layers = self.batches.network.point_widths.len();
        let clouds = self.batches.learned_clouds(random);
        point_net::center(&mut self.weights, n_layers, &clouds)
    }

    /// Goes once through all motions that are learned from.
    ///
    /// # Errors
    ///
    /// Fails if training diverges.
    pub fn train_epoch(&mut self) -> Result<&Epoch, CgfError> {
        let number = self.curve.len();
        let mut random = Random::new(self.batches.seed, FIRST_EPOCH + number as u64);
        if self.statistics == Statistics::Measured && self.is_fixed_in(number) {
            self.fix_statistics(&mut random)?;
        }
        let learning_rate = self.config().learning_rate_of(number);
        let repeats = self.batches.rotations.repeats();
        let order: Vec<(usize, usize)> = random
            .permutation(self.training_tracks.len() * repeats)
            .into_iter()
            .map(|k| (self.training_tracks[k / repeats], k % repeats))
            .collect();
        let mut losses = Losses::default();
        for items in equal_chunks(&order, self.config().batch) {
            let share = items.len() as f32 / order.len() as f32;
            losses.add(&self.step(items, learning_rate, &mut random)?, share);
            if !losses.is_finite() {
                break;
            }
        }
        let first = self
            .curve
            .first()
            .map_or(losses.total, |e| e.training.total);
        if !losses.is_finite() || losses.total > DIVERGED * first {
            return Err(CgfError::Diverged {
                epoch: number + 1,
                loss: losses.total,
            });
        }
        let is_last = number + 1 == self.config().epochs;
        let validates = is_last || (number + 1).is_multiple_of(self.config().validation_epochs);
        let measure = |split| {
            if validates {
                self.measure(split)
            } else {
                Ok(None)
            }
        };
        let epoch = Epoch {
            epoch: number + 1,
            learning_rate,
            training: losses,
            held_out: measure(Split::HeldOut)?,
            unseen: measure(Split::Unseen)?,
        };
        if let Some(held_out) = epoch.held_out
            && self
                .best
                .as_ref()
                .is_none_or(|best| held_out.total < best.total)
        {
            self.best = Some(Best {
                epoch: number + 1,
                total: held_out.total,
                weights: self.weights.clone(),
            });
        }
        self.curve.push(epoch);
        Ok(&self.curve[number])
    }

    /// Measures the point network's statistics over all objects, once and for all.
    fn fix_statistics(&mut self, random: &mut Random) -> Result<(), CgfError> {
        let net = PointNet::new(&self.weights, self.batches.network.point_widths.len())?;
        let clouds = self.batches.learned_clouds(random);
        let pass = net.forward(&clouds, Statistics::Measured);
        pass.store(1.0, &mut self.weights)?;
        self.statistics = Statistics::Stored;
        Ok(())
    }

    fn step(
        &mut self,
        items: &[(usize, usize)],
        learning_rate: f64,
        random: &mut Random,
    ) -> Result<Losses, CgfError> {
        let batch = self.batches.to_learn(items, random);
        let (losses, mut gradients, measured) = self.objective.gradients(
            &self.weights,
            &self.batches.normalization,
            &batch,
            self.statistics,
        )?;
        if losses.is_finite() {
            if let Some(max_norm) = self.config().max_gradient_norm {
                adam::shorten(&mut gradients, max_norm);
            }
            self.adam.step(&mut self.weights, &gradients, learning_rate);
            if self.statistics == Statistics::Measured {
                point_net::store(&measured, MOMENTUM, &mut self.weights)?;
            }
        }
        Ok(losses)
    }

    /// Measures the losses of the motions of a split, if there are any.
    fn measure(&self, split: Split) -> Result<Option<Losses>, CgfError> {
        let tracks = self.batches.seen.of_split(split);
        if tracks.is_empty() {
            return Ok(None);
        }
        let mut losses = Losses::default();
        for chunk in equal_chunks(&tracks, self.config().batch) {
            let batch = self.batches.to_measure(chunk);
            let of_chunk =
                self.objective
                    .measure(&self.weights, &self.batches.normalization, &batch)?;
            losses.add(&of_chunk, chunk.len() as f32 / tracks.len() as f32);
        }
        Ok(Some(losses))
    }

    /// Gives the grasping functions of the best and of the last epoch.
    ///
    /// # Errors
    ///
    /// Fails if their weights are no longer numbers.
    pub fn finish(self) -> Result<TrainingResult, CgfError> {
        let hand = self.objective.hand;
        let learned = self.set.tracks.iter();
        let learned = learned.filter(|track| track.split == Split::Training);
        let learned = learned.map(|track| &self.set.scenes[track.scene].object);
        let known_before = self.known_before.into_iter().flatten();
        let objects: BTreeSet<String> = learned.chain(known_before).cloned().collect();
        let description = |epoch: usize| Description {
            version: VERSION.to_owned(),
            epoch,
            joints: hand.joint_names(),
            joint_ranges: ranges(hand),
            network: self.batches.network.clone(),
            training: self.batches.training.clone(),
            seed: self.batches.seed,
            normalization: self.batches.normalization.clone(),
            local_normalization: self.objective.local_normalization.clone(),
            data: Vec::new(),
            objects: objects.clone(),
            demonstrations: Vec::new(),
            training_curve: self.curve.clone(),
        };
        let cgf = |epoch, weights| {
            let mut cgf = Cgf::new(description(epoch), weights)?;
            cgf.learn_posteriors(self.set)?;
            Ok::<_, CgfError>(cgf)
        };
        let last = cgf(self.curve.len(), self.weights)?;
        let best = match self.best {
            Some(best) => cgf(best.epoch, best.weights)?,
            None => last.clone(),
        };
        Ok(TrainingResult { best, last })
    }
}

/// Checks the motions of a set.
fn check(set: &TrainingSet, hand: &RobotModel, network: &NetworkConfig) -> Result<(), CgfError> {
    for track in &set.tracks {
        track.check(hand.dof())?;
        if let Some(code) = &track.code {
            check_width("latent", code.len(), network.latent_dim)?;
        }
        assert!(track.scene < set.scenes.len(), "scene of `{}`", track.name);
    }
    Ok(())
}

/// Returns the links that are fingertips.
fn tips(hand: &RobotModel, training: &TrainingConfig) -> Result<Vec<usize>, CgfError> {
    let tips = training.tips.iter();
    tips.map(|tip| {
        hand.link(tip)
            .ok_or_else(|| CgfError::UnknownLink { link: tip.clone() })
    })
    .collect()
}

/// Returns the room that the hand takes up, to keep it out of the objects of a set.
///
/// # Errors
///
/// Fails if the set lacks the distances to an object, or a link's shape is too large.
fn body(set: &TrainingSet, hand: &Arc<RobotModel>) -> Result<Body, CgfError> {
    let is_missing = |scene: &&RestingObject| !set.distances.contains_key(&scene.object);
    if let Some(scene) = set.scenes.iter().find(is_missing) {
        let object = scene.object.clone();
        return Err(CgfError::NoDistances { object });
    }
    Body::new(hand.clone()).map_err(|large| CgfError::LargeShapes { link: large.link })
}

/// Draws hands of the motions that are learned from, turned as in training, as the network's numbers in
/// physical units.
fn samples(
    motions: &NetworkMotions,
    training_tracks: &[usize],
    rotations: &Rotations,
    random: &mut Random,
) -> Vec<Vec<f64>> {
    let mut samples = Vec::new();
    for &idx in training_tracks {
        let motion = &motions.tracks[idx];
        for repeat in 0..if rotations.turns() { 4 } else { 1 } {
            let fixed = rotations.fixed(idx, repeat);
            let rotation = fixed.unwrap_or_else(|| rotations.draw(random));
            let times = (0..=20).map(|k| f64::from(k) / 20.0);
            samples.extend(times.map(|t| hand_numbers::of(&turned(motion.track.at(t), &rotation))));
        }
    }
    samples
}

/// Returns the position range of each joint of a hand.
pub(crate) fn ranges(hand: &RobotModel) -> Vec<JointRange> {
    hand.joints().iter().map(JointRange::of).collect()
}

/// Cuts into as few chunks of at most `longest` as possible, of equal length but for one.
pub(crate) fn equal_chunks<T>(order: &[T], longest: usize) -> Vec<&[T]> {
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
