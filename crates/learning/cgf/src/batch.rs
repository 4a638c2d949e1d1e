//! Batches of one optimizer step, from motions and the objects that they reach for.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::{Point3, UnitQuaternion};
use schemas::training::Split;
use spatial::Pose;

use crate::{
    CgfError, TrainingSet,
    augmentation::Rotations,
    basis_points::{self, NearSurface},
    config::{
        EncoderRotation, EncoderTimes, LatentNoise, LatentPrior, NetworkConfig, Times,
        TrainingConfig,
    },
    data::{NetworkFrame, TrainingMotion, View, turned},
    hand_numbers::{self, Normalization},
    model::equal_times,
    penetration::PenetrationScene,
    point_net::Clouds,
    precision::{narrow, narrow_all, row_index},
    random::Random,
};

/// The motions of a training as the network sees them.
pub(crate) struct NetworkMotions {
    /// The objects, each once in each way the network sees it.
    pub(crate) views: Vec<View>,
    /// The motions, in the frame of their object's view.
    pub(crate) tracks: Vec<SeenTrack>,
}

/// A motion as the network sees it.
pub(crate) struct SeenTrack {
    pub(crate) view: usize,
    pub(crate) split: Split,
    pub(crate) track: TrainingMotion<NetworkFrame>,
    /// Times that are drawn once, if times are.
    fixed_times: Vec<f64>,
    /// Distance field of the object and pose of the table, if the set has the object's field.
    surroundings: Option<PenetrationScene>,
}

/// Builder of batches.
pub(crate) struct Batches<'a> {
    pub(crate) network: &'a NetworkConfig,
    pub(crate) training: &'a TrainingConfig,
    pub(crate) seed: u64,
    pub(crate) seen: NetworkMotions,
    pub(crate) normalization: Normalization,
    pub(crate) rotations: Rotations,
}

/// Inputs and targets of one optimizer step.
pub(crate) struct Batch {
    /// Number of motions.
    pub(crate) size: usize,
    /// Times of each motion.
    pub(crate) n_times: usize,
    /// The object clouds, one for each view of the batch, and their surfaces.
    pub(crate) clouds: Arc<Clouds>,
    pub(crate) surfaces: Vec<Vec<Point3<f64>>>,
    /// The same as a second decoder sees them, by view; empty without one.
    pub(crate) local: Vec<NearSurface>,
    /// Index of each motion's view, by motion.
    pub(crate) views: Vec<u32>,
    /// Distance field of the object and pose of the table, by motion; empty if the set has no fields.
    pub(crate) surroundings: Vec<PenetrationScene>,
    /// `(batch, encoder steps, encoder inputs)`, in the network's units.
    pub(crate) motions: Vec<f32>,
    /// `(batch, times)`.
    pub(crate) times: Vec<f32>,
    /// `(batch × times, outputs)`, in physical units and the network's.
    pub(crate) physical: Vec<f32>,
    pub(crate) targets: Vec<f32>,
    /// `(batch, latent)` or `(batch × times, latent)` from the standard normal distribution; empty to
    /// decode the mean codes.
    pub(crate) noise: Vec<f32>,
    /// Codes that are given, `(batch, latent)`, and 1 where a motion's code is the encoder's, 0 where it is given,
    /// `(batch)`.
    pub(crate) codes: Vec<f32>,
    pub(crate) is_encoded: Vec<f32>,
    /// `(batch, latent)` from the standard normal distribution and `(batch)` in 0..1, at which the flow is learned;
    /// empty if there is none.
    pub(crate) flow_noise: Vec<f32>,
    pub(crate) flow_times: Vec<f32>,
    /// Noise on the grasps from which a second decoder starts, `(batch, 6 + dof)` from the standard normal distribution;
    /// empty for none.
    pub(crate) local_noise: Vec<f32>,
}

impl NetworkMotions {
    /// Looks at all motions of a set.
    pub(crate) fn of(
        set: &TrainingSet,
        network: &NetworkConfig,
        training: &TrainingConfig,
        seed: u64,
    ) -> Result<Self, CgfError> {
        let mut views: Vec<View> = Vec::new();
        let mut of_scenes = Vec::with_capacity(set.scenes.len());
        let mut origins = Vec::with_capacity(set.scenes.len());
        for scene in &set.scenes {
            let view = View::of(scene, network.frame)?;
            origins.push((view.table_from_network, view.object_from_network));
            // In its own frame an object looks the same however it lies.
            let same = |other: &View| {
                other.object == view.object && other.points_in_network == view.points_in_network
            };
            let known = views.iter().position(same);
            of_scenes.push(known.unwrap_or(views.len()));
            if known.is_none() {
                views.push(view);
            }
        }
        let tracks = set.tracks.iter().map(|track| SeenTrack {
            view: of_scenes[track.scene],
            split: track.split,
            track: track.expressed_in(&origins[track.scene].0),
            surroundings: set
                .distances
                .get(&set.scenes[track.scene].object)
                .map(|field| PenetrationScene {
                    field: field.clone(),
                    object_from_network: origins[track.scene].1,
                    table_from_network: origins[track.scene].0,
                }),
            fixed_times: match training.times {
                Times::Continuous => equal_times(training.random_times).collect(),
                Times::Recorded => track.recorded_times(training.random_times, seed),
            },
        });
        let tracks = tracks.collect();
        Ok(Self { views, tracks })
    }

    /// Returns which motions are of a split.
    pub(crate) fn of_split(&self, split: Split) -> Vec<usize> {
        let tracks = self.tracks.iter().enumerate();
        let of_split = tracks.filter(|(_, track)| track.split == split);
        of_split.map(|(idx, _)| idx).collect()
    }
}

impl Batches<'_> {
    /// Makes a batch to learn from: turned, at random times, with noise. An item is a motion and which
    /// of its repeats it is.
    pub(crate) fn to_learn(&self, items: &[(usize, usize)], random: &mut Random) -> Batch {
        let mut batch = self.empty();
        // Redrawn rotations are shared by the motions of an object, and so is its cloud.
        let mut shared: BTreeMap<(usize, bool), (usize, UnitQuaternion<f64>)> = BTreeMap::new();
        for &(idx, repeat) in items {
            let seen = &self.seen.tracks[idx];
            // What a code means depends on how the object lies, so that a motion of a given code is not turned.
            let is_given = seen.track.code.is_some();
            let (view, rotation) = match self.rotations.fixed(idx, repeat) {
                Some(rotation) if !is_given => {
                    (self.add_view(&mut batch, seen.view, &rotation), rotation)
                }
                _ => *shared.entry((seen.view, is_given)).or_insert_with(|| {
                    let rotation = if is_given {
                        UnitQuaternion::identity()
                    } else {
                        self.rotations.draw(random)
                    };
                    (self.add_view(&mut batch, seen.view, &rotation), rotation)
                }),
            };
            let times = match self.training.times {
                Times::Continuous => (0..self.training.random_times)
                    .map(|_| random.uniform())
                    .collect(),
                Times::Recorded => seen.fixed_times.clone(),
            };
            self.add_motion(&mut batch, seen, view, &rotation, &times);
            let draws = match self.training.latent_noise {
                LatentNoise::PerMotion => 1,
                LatentNoise::PerTime => batch.n_times,
            };
            let noise = (0..draws * self.network.latent_dim).map(|_| narrow(random.normal()));
            batch.noise.extend(noise);
            if self.network.prior == LatentPrior::Flow {
                let noise = (0..self.network.latent_dim).map(|_| narrow(random.normal()));
                batch.flow_noise.extend(noise);
                batch.flow_times.push(narrow(random.uniform()));
            }
            if self.network.local_points > 0 {
                let width = basis_points::noise_width(seen.track.motion.joints().len());
                let noise = (0..width).map(|_| narrow(random.normal()));
                batch.local_noise.extend(noise);
            }
        }
        batch
    }

    /// Makes a batch to measure with: as it is, at the same times whenever it is made, without noise.
    pub(crate) fn to_measure(&self, tracks: &[usize]) -> Batch {
        let mut batch = self.empty();
        let rotation = UnitQuaternion::identity();
        let mut views = BTreeMap::new();
        for &idx in tracks {
            let seen = &self.seen.tracks[idx];
            let view = *views
                .entry(seen.view)
                .or_insert_with(|| self.add_view(&mut batch, seen.view, &rotation));
            self.add_motion(&mut batch, seen, view, &rotation, &seen.fixed_times);
        }
        batch
    }

    /// Returns one cloud of every view that is learned from, turned at random.
    pub(crate) fn learned_clouds(&self, random: &mut Random) -> Clouds {
        let mut views = BTreeMap::new();
        for idx in self.seen.of_split(Split::Training) {
            views.entry(self.seen.tracks[idx].view).or_insert(idx);
        }
        let mut batch = self.empty();
        for (view, idx) in views {
            let repeat = random.index(self.rotations.repeats());
            let fixed = self.rotations.fixed(idx, repeat);
            let rotation = fixed.unwrap_or_else(|| self.rotations.draw(random));
            self.add_view(&mut batch, view, &rotation);
        }
        Arc::unwrap_or_clone(batch.clouds)
    }

    fn empty(&self) -> Batch {
        Batch {
            size: 0,
            n_times: self.training.grasp_steps + self.training.random_times,
            clouds: Arc::new(Clouds {
                points: self.network.points,
                xyz: Vec::new(),
            }),
            surfaces: Vec::new(),
            local: Vec::new(),
            views: Vec::new(),
            surroundings: Vec::new(),
            motions: Vec::new(),
            times: Vec::new(),
            physical: Vec::new(),
            targets: Vec::new(),
            noise: Vec::new(),
            codes: Vec::new(),
            is_encoded: Vec::new(),
            flow_noise: Vec::new(),
            flow_times: Vec::new(),
            local_noise: Vec::new(),
        }
    }

    /// Adds an object and returns its place in the batch.
    fn add_view(&self, batch: &mut Batch, view: usize, rotation: &UnitQuaternion<f64>) -> usize {
        let view = &self.seen.views[view];
        let cloud = view.cloud(self.network.points, rotation);
        Arc::make_mut(&mut batch.clouds).xyz.extend(cloud);
        let surface = view.points_in_network.iter().map(|point| rotation * point);
        let surface: Vec<_> = surface.collect();
        if self.network.local_points > 0 {
            let table = Pose::new(*view.table_from_network * rotation.inverse());
            batch.local.push(NearSurface::new(&surface, table));
        }
        batch.surfaces.push(surface);
        batch.surfaces.len() - 1
    }

    fn add_motion(
        &self,
        batch: &mut Batch,
        seen: &SeenTrack,
        view: usize,
        rotation: &UnitQuaternion<f64>,
        times: &[f64],
    ) {
        batch.size += 1;
        let code = seen.track.code.as_deref();
        batch
            .is_encoded
            .push(if code.is_some() { 0.0 } else { 1.0 });
        let none = vec![0.0; self.network.latent_dim];
        batch.codes.extend(narrow_all(code.unwrap_or(&none)));
        batch.views.push(row_index(view));
        let surroundings = seen
            .surroundings
            .iter()
            .map(|around| around.turned(rotation));
        batch.surroundings.extend(surroundings);
        let steps = encoder_times(self.network, &seen.track, self.seed);
        batch.motions.extend(encoder_motion(
            self.network,
            &seen.track,
            &steps,
            rotation,
            &self.normalization,
        ));
        let last = seen.track.last_times(self.training.grasp_steps);
        for t in last.into_iter().chain(times.iter().copied()) {
            let numbers = hand_numbers::of(&turned(seen.track.at(t), rotation));
            batch.times.push(narrow(t));
            batch.targets.extend(self.normalization.normalize(&numbers));
            batch.physical.extend(numbers.into_iter().map(narrow));
        }
    }
}

/// Returns the times at which the encoder sees a motion.
pub(crate) fn encoder_times(
    network: &NetworkConfig,
    track: &TrainingMotion<NetworkFrame>,
    seed: u64,
) -> Vec<f64> {
    match network.encoder_times {
        EncoderTimes::Equal => equal_times(network.encoder_steps).collect(),
        EncoderTimes::Recorded => track.recorded_times(network.encoder_steps, seed),
    }
}

/// Returns the encoder's inputs for a motion at `times`, in the network's units.
pub(crate) fn encoder_motion(
    network: &NetworkConfig,
    track: &TrainingMotion<NetworkFrame>,
    times: &[f64],
    rotation: &UnitQuaternion<f64>,
    normalization: &Normalization,
) -> Vec<f32> {
    let numbers = |&t: &f64| {
        let grasp = turned(track.at(t), rotation);
        match network.encoder_rotation {
            EncoderRotation::Columns => normalization.normalize(&hand_numbers::of(&grasp)),
            EncoderRotation::AxisAngle => {
                normalization.normalize_axis_angle(&hand_numbers::with_axis_angle(&grasp))
            }
        }
    };
    times.iter().flat_map(numbers).collect()
}
