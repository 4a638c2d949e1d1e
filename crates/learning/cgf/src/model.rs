//! A trained grasping function: decoding, encoding, and its two files.

use std::{collections::BTreeSet, path::Path};

use motion::HandState;
use nalgebra::{UnitQuaternion, Vector3};
use options::Options;
use rayon::prelude::*;
use schemas::{checkpoint::VERSION, training::Split};
use serde::{Deserialize, Serialize};
use spatial::{Pose, RestingPose, Table};

use crate::{
    CgfError, Epoch, HandMotionState, RestingObject, TrainingMotion, TrainingSet,
    basis_points::{self, GraspFrame, NearSurface},
    batch::{encoder_motion, encoder_times},
    config::{LatentPrior, NetworkConfig, TrainingConfig},
    data::{NetworkFrame, View},
    decoder::{Decoder, check_width},
    files::{self, read},
    hand_numbers::{Normalization, PALM_WIDTH},
    limits::{JointRange, Limits},
    network::{self, Network, constant},
    point_net::{Clouds, PointNet, Statistics},
    precision::narrow,
    weights::{WeightTensors, Weights},
};

/// A continuous grasping function f(t, z, object) with the encoder it was trained with.
#[derive(Debug, Clone)]
pub struct Cgf {
    description: Description,
    weights: Weights,
    leaves: WeightTensors,
    decoder: Decoder<f32>,
    local: Option<Local>,
}

/// The second decoder.
#[derive(Debug, Clone)]
struct Local {
    decoder: Decoder<f32>,
    /// The points about the palm from which it sees the object.
    points: Vec<f32>,
}

/// Where the second decoder starts, by motion.
struct Starts {
    /// The palms of the grasps before.
    palms: Vec<Pose<Table, GraspFrame>>,
    /// The latent codes, each followed by the object as seen from the palm.
    codes: Vec<Vec<f64>>,
}

/// Everything about a grasping function but its weights: the checkpoint's JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Version of the form, [`schemas::checkpoint::VERSION`].
    pub version: String,
    /// Number of the epoch after which the weights were taken, from 1.
    pub epoch: usize,
    /// Names of the hand's joints, in the order of the outputs after the first nine.
    pub joints: Vec<String>,
    /// Position range of each of them.
    pub joint_ranges: Vec<JointRange>,
    /// Widths and shapes.
    pub network: NetworkConfig,
    /// Training options.
    pub training: TrainingConfig,
    /// Seed of weights and noise.
    pub seed: u64,
    /// Units of the outputs: translation (m), two columns of the rotation, joint positions (rad).
    pub normalization: Normalization,
    /// Those of the second decoder, whose palm is relative to that of the first one's grasp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub local_normalization: Option<Normalization>,
    /// Sources of the motions and their terms of use, as their datasets state them.
    pub data: Vec<String>,
    /// Names of the objects that it has learned from, in this training and in those before from which it goes on.
    pub objects: BTreeSet<String>,
    /// Encoded motions of all splits; motions whose codes were given are not among them.
    pub demonstrations: Vec<EncodedDemonstration>,
    /// Learning curve: losses of all epochs.
    pub training_curve: Vec<Epoch>,
}

/// Latent code and reconstruction error of a motion of the training set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncodedDemonstration {
    /// The recording's name.
    pub name: String,
    /// The object's name.
    pub object: String,
    /// Whether the network was trained on it.
    pub split: Split,
    /// Resting orientation of the object: unit vector against gravity, object frame.
    pub rest_up: [f64; 3],
    /// Resting height of the object: its origin above the table, in meters.
    pub rest_height_m: f64,
    /// Mean of its latent code.
    pub latent_mean: Vec<f64>,
    /// Standard deviation of its latent code.
    pub latent_deviation: Vec<f64>,
    /// Reconstruction error at the grasp: the motion decoded from the mean code against the original.
    pub grasp_error: HandDistance,
}

/// Distance between two grasps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandDistance {
    /// Distance of the palms' origins, in meters.
    pub position_m: f64,
    /// Angle between the palms, in radians.
    pub rotation_rad: f64,
    /// Root mean square difference of the joint positions, in radians.
    pub joints_rad: f64,
}

/// The network's feature of an object in its resting pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectFeature {
    pub(crate) values: Vec<f32>,
    /// Pose of the frame in which the network's outputs for this object are.
    pub(crate) table_from_network: Pose<Table, NetworkFrame>,
    /// The object as the second decoder sees it.
    pub(crate) surface: NearSurface,
}

/// The distribution of a motion's latent code: independent normal distributions.
#[derive(Debug, Clone, PartialEq)]
pub struct Posterior {
    /// Means.
    pub mean: Vec<f64>,
    /// Standard deviations.
    pub deviation: Vec<f64>,
}

impl Cgf {
    pub(crate) fn new(description: Description, weights: Weights) -> Result<Self, CgfError> {
        let leaves = weights.constants()?;
        let limits = Limits::new(description.network.joints, &description.joint_ranges);
        let network = &description.network;
        let local = description.local_normalization.as_ref();
        let local = local.map(|normalization| {
            let hidden = network.local_widths.len();
            let (name, limits) = (("local", hidden), limits.clone());
            Ok::<_, CgfError>(Local {
                decoder: Decoder::new(name, network.activation, normalization, limits, &weights)?,
                points: weights.array(basis_points::NAME)?.values.clone(),
            })
        });
        let local = local.transpose()?;
        let decoder = Decoder::new(
            ("decoder", network.decoder_widths.len()),
            network.activation,
            &description.normalization,
            limits,
            &weights,
        )?;
        Ok(Self {
            description,
            weights,
            leaves,
            decoder,
            local,
        })
    }

    /// Returns everything but the weights.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns the weights by name.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Computes the network's feature of an object in its resting pose.
    ///
    /// # Errors
    ///
    /// Fails if the object has too few points or they are not finite.
    pub fn feature(&self, scene: &RestingObject) -> Result<ObjectFeature, CgfError> {
        let config = &self.description.network;
        let view = View::of(scene, config.frame)?;
        let clouds = Clouds {
            points: config.points,
            xyz: view.cloud(config.points, &UnitQuaternion::identity()),
        };
        let net = PointNet::new(&self.weights, config.point_widths.len())?;
        Ok(ObjectFeature {
            values: net.forward(&clouds, Statistics::Stored).features,
            table_from_network: view.table_from_network,
            surface: NearSurface::new(&view.points_in_network, view.table_from_network),
        })
    }

    /// Takes numbers of the standard normal distribution to codes of an object's motions: themselves, or along the
    /// flow.
    ///
    /// # Errors
    ///
    /// Fails if one does not have the network's width.
    pub fn prior_codes(
        &self,
        feature: &ObjectFeature,
        noise: Vec<Vec<f64>>,
    ) -> Result<Vec<Vec<f64>>, CgfError> {
        let width = self.description.network.latent_dim;
        if self.description.network.prior == LatentPrior::Normal || noise.is_empty() {
            return Ok(noise);
        }
        for row in &noise {
            check_width("latent", row.len(), width)?;
        }
        let numbers = noise.iter().flatten().copied().map(narrow).collect();
        let noise = constant(numbers, &[noise.len(), width])?;
        let feature = constant(feature.values.clone(), &[1, feature.values.len()])?;
        let scenes = candle_core::Tensor::zeros(
            noise.dim(0)?,
            candle_core::DType::U32,
            &candle_core::Device::Cpu,
        )?;
        let codes = self
            .network()
            .flowed(noise, &feature, &scenes)?
            .to_vec2::<f32>()?;
        let wide = |code: Vec<f32>| code.into_iter().map(f64::from).collect();
        Ok(codes.into_iter().map(wide).collect())
    }

    /// Decodes latent codes at `times` in 0..=1 (1 far, 0 the grasp): for each code, the hand at each
    /// time, above the table.
    ///
    /// # Errors
    ///
    /// Fails if a code does not have the network's width or the outputs are not a rotation.
    pub fn decode(
        &self,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<HandState<Table>>>, CgfError> {
        let values = &feature.values;
        let Some(local) = &self.local else {
            let motions = self.decoder.decode(values, latents, times)?;
            let above =
                |hand: HandState<NetworkFrame>| hand.expressed_in(&feature.table_from_network);
            return Ok(mapped(motions, |_| above));
        };
        let starts = self.starts(local, feature, latents)?;
        let motions = local.decoder.decode(values, &starts.codes, times)?;
        Ok(mapped(motions, |idx| {
            let palm = &starts.palms[idx];
            move |hand: HandState<GraspFrame>| hand.expressed_in(palm)
        }))
    }

    /// Decodes as [`Cgf::decode`], with velocity and acceleration: exact first and second derivatives
    /// with respect to t, by forward propagation through the network and the map from its outputs to a
    /// rotation. With `activation = "relu"` the outputs' second derivatives are zero almost everywhere.
    ///
    /// # Errors
    ///
    /// Fails as it does.
    pub fn decode_with_rates(
        &self,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
        times: &[f64],
    ) -> Result<Vec<Vec<HandMotionState>>, CgfError> {
        let values = &feature.values;
        let Some(local) = &self.local else {
            let motions = self.decoder.decode_with_rates(values, latents, times)?;
            let above = |hand: HandMotionState<NetworkFrame>| {
                hand.expressed_in(&feature.table_from_network)
            };
            return Ok(mapped(motions, |_| above));
        };
        let starts = self.starts(local, feature, latents)?;
        let motions = (local.decoder).decode_with_rates(values, &starts.codes, times)?;
        Ok(mapped(motions, |idx| {
            let palm = &starts.palms[idx];
            move |hand: HandMotionState<GraspFrame>| hand.expressed_in(palm)
        }))
    }

    /// Returns where the second decoder starts for these latent codes.
    fn starts(
        &self,
        local: &Local,
        feature: &ObjectFeature,
        latents: &[Vec<f64>],
    ) -> Result<Starts, CgfError> {
        let grasps = self.decoder.decode(&feature.values, latents, &[0.0])?;
        let grasps: Vec<HandState<NetworkFrame>> = grasps.into_iter().flatten().collect();
        let pairs = latents.par_iter().zip(&grasps);
        let codes = pairs.map(|(latent, grasp)| {
            let seen = feature.surface.code(&local.points, grasp);
            let seen = seen.into_iter().map(f64::from);
            latent.iter().copied().chain(seen).collect()
        });
        let palm = |grasp: &HandState<NetworkFrame>| {
            Pose::new(*(feature.table_from_network * grasp.frame_from_palm))
        };
        Ok(Starts {
            palms: grasps.iter().map(palm).collect(),
            codes: codes.collect(),
        })
    }

    /// Returns the distribution of a motion's latent code.
    ///
    /// # Errors
    ///
    /// Fails if the motion is not one of this hand.
    pub fn encode(
        &self,
        feature: &ObjectFeature,
        track: &TrainingMotion,
    ) -> Result<Posterior, CgfError> {
        track.check(self.description.joints.len())?;
        let network = &self.description.network;
        let track = track.expressed_in(&feature.table_from_network);
        let times = encoder_times(network, &track, self.description.seed);
        let motion = encoder_motion(
            network,
            &track,
            &times,
            &UnitQuaternion::identity(),
            &self.description.normalization,
        );
        let inputs = network.encoder_inputs(self.description.joints.len());
        let scenes =
            candle_core::Tensor::zeros(1, candle_core::DType::U32, &candle_core::Device::Cpu)?;
        let (mean, log_variance) = self.network().encode(
            &constant(motion, &[1, times.len(), inputs])?,
            &constant(feature.values.clone(), &[1, feature.values.len()])?,
            &scenes,
        )?;
        let numbers = |tensor: &candle_core::Tensor| tensor.flatten_all()?.to_vec1::<f32>();
        Ok(Posterior {
            mean: numbers(&mean)?.into_iter().map(f64::from).collect(),
            deviation: numbers(&log_variance)?
                .into_iter()
                .map(|x| (0.5 * f64::from(x)).exp())
                .collect(),
        })
    }

    fn network(&self) -> Network<'_> {
        Network {
            config: &self.description.network,
            leaves: &self.leaves,
        }
    }

    /// Encodes the motions of the training set that have no given code, and stores the results.
    pub(crate) fn learn_posteriors(&mut self, set: &TrainingSet) -> Result<(), CgfError> {
        let features = set
            .scenes
            .iter()
            .map(|scene| self.feature(scene))
            .collect::<Result<Vec<_>, _>>()?;
        let mut demonstrations = Vec::with_capacity(set.tracks.len());
        for track in set.tracks.iter().filter(|track| track.code.is_none()) {
            let (scene, feature) = (&set.scenes[track.scene], &features[track.scene]);
            let posterior = self.encode(feature, track)?;
            let decoded = self.decode(feature, std::slice::from_ref(&posterior.mean), &[0.0])?;
            let shown = track.at(0.0);
            let grasp_error = decoded.first().and_then(|motion| motion.first()).map_or(
                HandDistance {
                    position_m: 0.0,
                    rotation_rad: 0.0,
                    joints_rad: 0.0,
                },
                |grasp| HandDistance::between(grasp, &shown),
            );
            demonstrations.push(EncodedDemonstration {
                name: track.name.clone(),
                object: scene.object.clone(),
                split: track.split,
                rest_up: scene.rest.up_in_object.into_inner().into(),
                rest_height_m: scene.rest.height_m,
                latent_mean: posterior.mean,
                latent_deviation: posterior.deviation,
                grasp_error,
            });
        }
        self.description.demonstrations = demonstrations;
        Ok(())
    }

    /// Sets [`Description::data`].
    pub fn set_data(&mut self, data: Vec<String>) {
        self.description.data = data;
    }

    /// Writes the two files.
    ///
    /// # Errors
    ///
    /// Fails if they cannot be written.
    pub fn save(&self, weights: &Path, description: &Path) -> Result<(), CgfError> {
        files::save(&self.weights, weights, &self.description, description)
    }

    /// Reads the two files.
    ///
    /// # Errors
    ///
    /// Fails if they cannot be read, are damaged, or do not fit together.
    pub fn load(weights: &Path, description: &Path) -> Result<Self, CgfError> {
        let description = Description::read(description)?;
        description.network.check()?;
        let weights = Weights::from_bytes(&read(weights)?)?;
        let outputs = PALM_WIDTH + description.joints.len();
        let dof = description.joints.len();
        let initialization = description.training.initialization;
        let expected = network::initialize(&description.network, dof, initialization, 0);
        weights.check_like(&expected)?;
        description.normalization.check(outputs)?;
        match &description.local_normalization {
            Some(local) => local.check(outputs)?,
            None if description.network.local_points == 0 => {}
            None => return Err(CgfError::NoLocalNormalization),
        }
        Self::new(description, weights)
    }

    /// Checks that the checkpoint was trained with this hand.
    ///
    /// # Errors
    ///
    /// Fails if the hand's joints have other names or another order.
    pub fn check_hand(&self, joints: &[String]) -> Result<(), CgfError> {
        if self.description.joints == joints {
            Ok(())
        } else {
            Err(CgfError::AnotherHand {
                expected: joints.to_vec(),
                found: self.description.joints.clone(),
            })
        }
    }

    /// Returns `steps` times from 1 (far) to 0 (the grasp), equally spaced.
    pub fn times(steps: usize) -> Vec<f64> {
        equal_times(steps).collect()
    }
}

/// Maps the hands of motions, those of a motion by its function.
fn mapped<A: Send, B: Send, M: Fn(A) -> B>(
    motions: Vec<Vec<A>>,
    of: impl Fn(usize) -> M + Sync,
) -> Vec<Vec<B>> {
    let motions = motions.into_par_iter().enumerate();
    motions
        .map(|(idx, hands)| hands.into_iter().map(of(idx)).collect())
        .collect()
}

/// Returns `n` times from 1 (far) to 0 (the grasp).
pub(crate) fn equal_times(n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |k| (n - 1 - k) as f64 / (n.max(2) - 1) as f64)
}

impl Description {
    /// Returns the demonstrations of a split.
    pub fn of_split(&self, split: Split) -> impl Iterator<Item = &EncodedDemonstration> {
        let all = self.demonstrations.iter();
        all.filter(move |demonstration| demonstration.split == split)
    }

    /// Reads a checkpoint's JSON.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be read, is damaged or of another version.
    pub fn read(path: &Path) -> Result<Self, CgfError> {
        /// What all versions have.
        #[derive(Deserialize)]
        struct AnyVersion {
            version: String,
        }
        let json = read(path)?;
        let AnyVersion { version } = serde_json::from_slice(&json)?;
        if version != VERSION {
            return Err(CgfError::Version {
                expected: VERSION,
                found: version,
            });
        }
        let description: Self = serde_json::from_slice(&json)?;
        let mut demonstrations = description.demonstrations.iter();
        if let Some(one) = demonstrations.find(|one| !one.has_rest()) {
            return Err(CgfError::RestingPose {
                demonstration: one.name.clone(),
            });
        }
        Ok(description)
    }
}

impl EncodedDemonstration {
    /// Whether the direction against gravity is one, about a unit vector.
    fn has_rest(&self) -> bool {
        (Vector3::from(self.rest_up).norm() - 1.0).abs() < 1e-3 && self.rest_height_m.is_finite()
    }

    /// Says whether the network was trained on it.
    pub fn is_learned(&self) -> bool {
        self.split == Split::Training
    }

    /// Returns the object's resting pose.
    pub fn rest(&self) -> RestingPose {
        RestingPose {
            up_in_object: nalgebra::Unit::new_normalize(Vector3::from(self.rest_up)),
            height_m: self.rest_height_m,
        }
    }
}

impl HandDistance {
    /// Returns the distance between two grasps of one hand.
    pub fn between(a: &HandState<Table>, b: &HandState<Table>) -> Self {
        let (pose_a, pose_b) = (a.frame_from_palm, b.frame_from_palm);
        let squares: f64 = a
            .q_rad
            .iter()
            .zip(&b.q_rad)
            .map(|(a, b)| (a - b).powi(2))
            .sum();
        Self {
            position_m: (pose_a.translation.vector - pose_b.translation.vector).norm(),
            rotation_rad: pose_a.rotation.angle_to(&pose_b.rotation),
            joints_rad: (squares / a.q_rad.len().max(1) as f64).sqrt(),
        }
    }
}
