//! What one step of the optimizer sees, made of motions and the objects they reach for.

use nalgebra::{Point3, UnitQuaternion};

use crate::{
    CgfError, TrainingSet,
    augmentation::Rotations,
    config::{EncoderRotation, EncoderTimes, LatentNoise, NetworkConfig, Times, TrainingConfig},
    data::{Split, Track, View, turned},
    grasp::Normalization,
    model::equal_times,
    point_net::Clouds,
    precision::{narrow, row_index},
    random::Random,
};

/// The motions of a training as the network sees them.
pub(crate) struct Seen {
    /// The objects, each once in each way the network sees it.
    pub(crate) views: Vec<View>,
    /// The motions, in the frame of their object's view.
    pub(crate) tracks: Vec<SeenTrack>,
}

/// A motion as the network sees it.
pub(crate) struct SeenTrack {
    pub(crate) view: usize,
    pub(crate) split: Split,
    pub(crate) track: Track,
    /// Times that are drawn once, if times are.
    fixed_times: Vec<f64>,
}

/// How batches are made.
pub(crate) struct Batches<'a> {
    pub(crate) network: &'a NetworkConfig,
    pub(crate) training: &'a TrainingConfig,
    pub(crate) seed: u64,
    pub(crate) seen: Seen,
    pub(crate) normalization: Normalization,
    pub(crate) rotations: Rotations,
}

/// What one step of the optimizer sees.
pub(crate) struct Batch {
    /// Number of motions.
    pub(crate) size: usize,
    /// Times of each motion.
    pub(crate) n_times: usize,
    /// The object clouds, one for each view of the batch, and their surfaces.
    pub(crate) clouds: Clouds,
    pub(crate) surfaces: Vec<Vec<Point3<f64>>>,
    /// Which of them each motion has.
    pub(crate) views: Vec<u32>,
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
}

impl Seen {
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
            origins.push(view.table_from_network);
            // In its own frame an object looks the same however it lies.
            let same = |other: &View| other.object == view.object && other.points == view.points;
            let known = views.iter().position(same);
            of_scenes.push(known.unwrap_or(views.len()));
            if known.is_none() {
                views.push(view);
            }
        }
        let tracks = set.tracks.iter().map(|track| SeenTrack {
            view: of_scenes[track.scene],
            split: track.split,
            track: track.seen_from(&origins[track.scene]),
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
    /// Makes a batch to learn from: turned, at random times, with noise.
    pub(crate) fn to_learn(&self, tracks: &[usize], random: &mut Random) -> Batch {
        let used = self.views_of(tracks);
        let rotations: Vec<_> = used
            .iter()
            .map(|&view| self.rotations.draw(view, random))
            .collect();
        let mut batch = self.objects(&used, &rotations);
        for &idx in tracks {
            let seen = &self.seen.tracks[idx];
            let times = match self.training.times {
                Times::Continuous => (0..self.training.random_times)
                    .map(|_| random.uniform())
                    .collect(),
                Times::Recorded => seen.fixed_times.clone(),
            };
            let view = used.partition_point(|&view| view < seen.view);
            self.add(&mut batch, seen, view, &rotations[view], &times);
            let draws = match self.training.latent_noise {
                LatentNoise::PerMotion => 1,
                LatentNoise::PerTime => batch.n_times,
            };
            let noise = (0..draws * self.network.latent_dim).map(|_| narrow(random.normal()));
            batch.noise.extend(noise);
        }
        batch
    }

    /// Makes a batch to measure with: as it is, at the same times whenever it is made, without noise.
    pub(crate) fn to_measure(&self, tracks: &[usize]) -> Batch {
        let used = self.views_of(tracks);
        let rotations = vec![UnitQuaternion::identity(); used.len()];
        let mut batch = self.objects(&used, &rotations);
        for &idx in tracks {
            let seen = &self.seen.tracks[idx];
            let view = used.partition_point(|&view| view < seen.view);
            self.add(&mut batch, seen, view, &rotations[view], &seen.fixed_times);
        }
        batch
    }

    /// Returns one cloud of every view that is learned from, turned at random.
    pub(crate) fn learned_clouds(&self, random: &mut Random) -> Clouds {
        let used = self.views_of(&self.seen.of_split(Split::Training));
        let points = self.network.points;
        let mut xyz = Vec::with_capacity(used.len() * 3 * points);
        for view in used {
            let rotation = self.rotations.draw(view, random);
            xyz.extend(self.seen.views[view].cloud(points, &rotation));
        }
        Clouds { points, xyz }
    }

    /// Returns the views of motions, each once, in order.
    fn views_of(&self, tracks: &[usize]) -> Vec<usize> {
        let views = tracks.iter().map(|&idx| self.seen.tracks[idx].view);
        let mut used: Vec<usize> = views.collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    /// A batch without motions.
    fn objects(&self, used: &[usize], rotations: &[UnitQuaternion<f64>]) -> Batch {
        let points = self.network.points;
        let mut clouds = Clouds {
            points,
            xyz: Vec::with_capacity(used.len() * 3 * points),
        };
        let mut surfaces = Vec::with_capacity(used.len());
        for (&view, rotation) in used.iter().zip(rotations) {
            let view = &self.seen.views[view];
            clouds.xyz.extend(view.cloud(points, rotation));
            surfaces.push(view.points.iter().map(|point| rotation * point).collect());
        }
        Batch {
            size: 0,
            n_times: self.training.grasp_steps + self.training.random_times,
            clouds,
            surfaces,
            views: Vec::new(),
            motions: Vec::new(),
            times: Vec::new(),
            physical: Vec::new(),
            targets: Vec::new(),
            noise: Vec::new(),
        }
    }

    fn add(
        &self,
        batch: &mut Batch,
        seen: &SeenTrack,
        view: usize,
        rotation: &UnitQuaternion<f64>,
        times: &[f64],
    ) {
        batch.size += 1;
        batch.views.push(row_index(view));
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
            let numbers = turned(&seen.track.at(t), rotation).to_numbers();
            batch.times.push(narrow(t));
            batch.targets.extend(self.normalization.normalize(&numbers));
            batch.physical.extend(numbers.into_iter().map(narrow));
        }
    }
}

/// Returns the times at which the encoder sees a motion.
pub(crate) fn encoder_times(network: &NetworkConfig, track: &Track, seed: u64) -> Vec<f64> {
    match network.encoder_times {
        EncoderTimes::Equal => equal_times(network.encoder_steps).collect(),
        EncoderTimes::Recorded => track.recorded_times(network.encoder_steps, seed),
    }
}

/// Returns what the encoder sees of a motion at `times`, in the network's units.
pub(crate) fn encoder_motion(
    network: &NetworkConfig,
    track: &Track,
    times: &[f64],
    rotation: &UnitQuaternion<f64>,
    normalization: &Normalization,
) -> Vec<f32> {
    let numbers = |&t: &f64| {
        let grasp = turned(&track.at(t), rotation);
        match network.encoder_rotation {
            EncoderRotation::Columns => normalization.normalize(&grasp.to_numbers()),
            EncoderRotation::AxisAngle => {
                normalization.normalize_axis_angle(&grasp.to_axis_angle_numbers())
            }
        }
    };
    times.iter().flat_map(numbers).collect()
}
