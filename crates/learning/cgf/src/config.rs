//! Options of the network and its training.

use candle_core::Device;
use options::{OptionFault, OptionFaults, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{CgfError, basis_points, hand_numbers::PALM_WIDTH};

/// Fewest surface points that still show an object's shape.
const MIN_POINTS: usize = 32;
/// Maximum number of surface points, thirty times the paper's.
const MAX_POINTS: usize = 65_536;
/// Maximum number of outputs of a layer, sixteen times the paper's widest.
const MAX_WIDTH: usize = 16_384;
/// Maximum number of points about the palm, thirty times what a hand needs.
const MAX_LOCAL_POINTS: usize = 4096;
/// Maximum number of layers of one part of the network.
const MAX_LAYERS: usize = 64;
/// Maximum number of weights: 5 GiB with gradients, Adam's moments and the best weights so far.
const MAX_WEIGHTS: usize = 1 << 28;
/// Maximum number of outputs of all layers in one step: 16 GiB, two hundred times the paper's.
const MAX_ACTIVATIONS: usize = 1 << 32;
/// Maximum number of times of one motion.
const MAX_TIMES: usize = 10_000;
/// Maximum number of epochs, a thousand times the paper's.
const MAX_EPOCHS: usize = 1_000_000;
/// Maximum number of motions in one step.
const MAX_BATCH: usize = 1_000_000;
/// Greatest weight, rate or length.
const MAX_VALUE: f64 = 1e12;
/// Reason for the bound [`MAX_VALUE`].
const SQUARES: &str = "squares of larger values lose precision in a sum";
/// Reason for the bound [`MAX_WIDTH`].
const OF_WIDTHS: &str = "the number of weights grows with the square of a width";
/// Smallest norm to which gradients are clipped.
const MIN_NORM: f64 = 1e-12;

/// Widths and shapes of the network (section III-B of the paper; `README.md` names the tensors).
// The widths are for hundreds of motions of tens of objects.
#[options(also = Self::width_faults)]
#[derive(PartialEq, Eq)]
pub struct NetworkConfig {
    /// Surface points of the object that the network sees: a quarter of the paper's give the same
    /// grasps in a fraction of the time; paper: 2000
    #[option(
        default = 512, range = MIN_POINTS..=MAX_POINTS,
        why = "time and memory grow with the number of points"
    )]
    pub points: usize,
    /// Widths of the point network's layers, the last is that of the object feature: enough for tens
    /// of objects; paper: [64, 128, 1024]
    #[option(default = vec![64, 128, 256])]
    pub point_widths: Vec<usize>,
    /// Steps of a motion that the encoder sees, as many as the released code's
    #[option(
        default = 20, range = 1..=MAX_TIMES,
        why = "the encoder's input grows with the number of steps"
    )]
    pub encoder_steps: usize,
    /// Widths of the layers applied to each of these steps, those of the released code
    #[option(default = vec![256, 64])]
    pub hand_widths: Vec<usize>,
    /// Widths of the encoder's layers before mean and variance, as the released code's last:
    /// `[256]`
    #[option(default = vec![256])]
    pub encoder_widths: Vec<usize>,
    /// Dimensions of the latent code z: hundreds of motions do not use more; paper: 256
    #[option(default = 16, range = 1..=MAX_WIDTH, why = OF_WIDTHS)]
    pub latent_dim: usize,
    /// Widths of the decoder's hidden layers, those of the released code; paper: [512, 256]
    #[option(default = vec![256, 512, 256])]
    pub decoder_widths: Vec<usize>,
    /// Points about the palm of the decoder's grasp, from which a second decoder sees the object: its motion
    /// replaces the first one's; paper: 0, no second decoder
    #[option(default = 0, range = 0..=MAX_LOCAL_POINTS, why = OF_WIDTHS)]
    pub local_points: usize,
    /// Widths of the second decoder's hidden layers
    #[option(default = vec![512, 512, 512])]
    pub local_widths: Vec<usize>,
    /// Activation of encoder and decoder: "silu" gives motions accelerations; paper: "relu", which has
    /// no second derivative in time
    #[option(default)]
    pub activation: Activation,
    /// Frame in which the network sees object and hand: once refined, motions of "resting" succeed on unseen
    /// objects 27 points more often than those of the paper's "object"
    #[option(default)]
    pub frame: InputFrame,
    /// Steps of a motion that the encoder sees: with equally spaced ones the motion's length does not
    /// matter; released code: "recorded"
    #[option(default)]
    pub encoder_times: EncoderTimes,
    /// Encoding of the palm's rotation: columns are continuous; released code: "`axis_angle`"
    #[option(default)]
    pub encoder_rotation: EncoderRotation,
    /// Bound on the variance of the posterior: no wider than the prior, so that one motion cannot ruin
    /// a training; paper: "free"
    #[option(default)]
    pub latent_variance: LatentVariance,
    /// Distribution of an object's latent codes: "flow" follows the posteriors, so that sampled codes are those of
    /// motions also with a small `kl_weight`; paper: "normal"
    #[option(default)]
    pub prior: LatentPrior,
    /// Range of the decoder's joint positions: within limits, so that a controller can execute every
    /// motion; paper: "free"
    #[option(default)]
    pub joints: JointOutputs,
}

/// The frame in which the network sees object and hand.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputFrame {
    /// The table under the resting object, z against gravity: the network knows where the table is.
    #[default]
    Resting,
    /// The object's own: motions about an object are independent of its resting orientation.
    Object,
}

/// Steps of a motion that the encoder sees.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EncoderTimes {
    /// Steps at equal times from the first to the grasp.
    #[default]
    Equal,
    /// Recorded ones, sampled once for each motion.
    Recorded,
}

/// Encoding of the palm's rotation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EncoderRotation {
    /// As the first two columns of its matrix.
    #[default]
    Columns,
    /// As axis times angle, which is discontinuous at a half turn.
    AxisAngle,
}

/// Bound on the variance of the posterior.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatentVariance {
    /// None: the encoder's output is the logarithm of the variance, which for an outlier motion can be
    /// so large that one step ruins a training.
    Free,
    /// At most the prior's variance, which is 1: `sigmoid(x)` of the last layer's x.
    #[default]
    BelowPrior,
}

/// Distribution of an object's latent codes, from which motions are sampled.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatentPrior {
    /// The standard normal distribution, whatever the object.
    #[default]
    Normal,
    /// A flow from the standard normal distribution, given the object's feature (Lipman et al., *Flow Matching for
    /// Generative Modeling*, 2023).
    Flow,
}

/// Range of the decoder's joint positions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JointOutputs {
    /// Anywhere.
    Free,
    /// Within the hand's limits: `middle + half · tanh((x − middle) / half)` of the last layer's x, where
    /// `half` is half of the joint's range.
    #[default]
    WithinLimits,
}

/// The activation between two layers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// `max(x, 0)`: motions are piecewise linear in time before the rotation map.
    Relu,
    /// `x / (1 + exp(−x))`: motions have velocities and accelerations.
    #[default]
    Silu,
}

/// Training options of the network.
#[options]
#[derive(PartialEq)]
pub struct TrainingConfig {
    /// Device for training, "cpu" if absent; "cuda" and "metal" need a program built with that feature
    #[option(default)]
    pub device: TrainingDevice,
    /// Passes over all trajectories: minutes, after which the held-out loss hardly improves; paper:
    /// 1000
    #[option(
        default = 150, range = 1..=MAX_EPOCHS,
        why = "the training curve has a row for each epoch"
    )]
    pub epochs: usize,
    /// Epochs between two validations on held-out motions: far enough apart to cost little; the last
    /// epoch is always validated
    #[option(default = 5, range = 1..=MAX_EPOCHS, why = "it is a number of epochs")]
    pub validation_epochs: usize,
    /// Trajectories per step of the optimizer: few, so that some hundred motions give enough steps;
    /// paper: 32
    #[option(default = 8, range = 1..=MAX_BATCH, why = "a step holds the whole batch in memory")]
    pub batch: usize,
    /// Adam's learning rate at the start: falls to zero within the few epochs; paper: 5e-4
    #[option(default = 2e-3, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub learning_rate: f64,
    /// Norm to which gradients are clipped; absent: never, as in the paper
    #[serde(skip_serializing_if = "Option::is_none")]
    #[option(
        default, range = MIN_NORM..=MAX_VALUE,
        why = "a smaller norm stops training, and a larger one never clips"
    )]
    pub max_gradient_norm: Option<f64>,
    /// Decay of the learning rate: to zero at the last epoch; paper: "halving"
    #[option(default)]
    pub schedule: Schedule,
    /// Epochs after which `schedule = "halving"` halves the learning rate, the paper's
    #[option(default = 500, range = 1..=MAX_EPOCHS, why = "it is a number of epochs")]
    pub halving_epochs: usize,
    /// Last steps of every motion that are always trained on, as in the released code: the grasp
    /// matters most
    #[option(
        default = 5, range = 1..=MAX_TIMES,
        why = "each is decoded for every motion of a batch"
    )]
    pub grasp_steps: usize,
    /// Weight of each of these steps in the losses, relative to every other time: contact needs more
    /// precision than the approach; paper: 1
    #[option(default = 5.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub grasp_weight: f64,
    /// Further times of every motion, redrawn each epoch: a dozen with those of the grasp; released
    /// code: 20
    #[option(
        default = 7, range = 0..=MAX_TIMES,
        why = "each is decoded for every motion of a batch"
    )]
    pub random_times: usize,
    /// Distribution of these further times: continuous, so that the motion is a function of time;
    /// released code: "recorded"
    #[option(default)]
    pub times: Times,
    /// Draws of a latent code's noise: one for each motion, as in sampling; released code:
    /// "`per_time`"
    #[option(default)]
    pub latent_noise: LatentNoise,
    /// Initialization of the weights: layers preserve the variance of their inputs; released code:
    /// "torch"
    #[option(default)]
    pub initialization: Initialization,
    /// Rotation of object and hand together during training: about the vertical, which takes the
    /// fingertips' error on unseen objects from 54 to 40 mm; released code: "released"
    #[option(default)]
    pub augmentation: Augmentation,
    /// Units of the network's outputs and of the position loss: with standardized ones meters and
    /// radians count equally; paper: "physical"
    #[option(default)]
    pub outputs: Outputs,
    /// Share of the epochs after which the point network's batch statistics are frozen: the second
    /// half is trained with the statistics of sampling; paper: 1
    #[option(default = 0.5, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub fixed_statistics_after: f64,
    /// Reduction of squared errors: with the mean, weights do not depend on the number of times and
    /// links; paper: "sum"
    #[option(default)]
    pub reduction: Reduction,
    /// Weight of the outputs' squared errors, in the units of `outputs`: the reference for the others;
    /// paper: 1
    #[option(default = 1.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub q_weight: f64,
    /// Weight of the translation's squared errors, in the units of `outputs`, in addition to
    /// `q_weight`: none, as in the paper; released code: 10
    #[option(default, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub translation_weight: f64,
    /// Weight of the link origins' squared distances, 1/m²: 10 cm count as much as a standard
    /// deviation of the outputs; paper: 10
    #[option(default = 100.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub origins_weight: f64,
    /// Weight of the squared errors of the first two columns of the links' rotations: none, as in
    /// the paper; released code: 0.5
    #[option(default, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub rotations_weight: f64,
    /// Weight of the latent code's divergence from the standard normal, 1/nat: with ten times as
    /// much, the error on unseen objects rises by 8 mm; paper: 1e-3
    #[option(default = 2e-3, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub kl_weight: f64,
    /// Weight of the fingertips' squared distances from contact, 1/m²: twice that of the links,
    /// because the fingertips hold the object; paper: 50
    #[option(default = 200.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_weight: f64,
    /// Weight of the squared depths of the links in object and table, 1/m²: depths are millimeters
    /// where distances are centimeters; paper: 0
    #[option(default = 5000.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub penetration_weight: f64,
    /// Standard deviation of the noise on the grasp from which the second decoder starts, of points 0.1 m from the
    /// palm, m: as large as the first one's misses with new codes; unused without `network.local_points`
    #[option(default = 0.01, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub local_noise_m: f64,
    /// Target of the contact loss for the fingertips at the grasp: they touch, and do not penetrate by
    /// their radius; paper: "`touch_center`"
    #[option(default)]
    pub contact: Contact,
    /// Names of the hand's fingertip links; no default in a stage: each hand has its own
    pub tips: Vec<String>,
    /// Radius of the fingertips about their links' origins, m; no default: each hand has its own;
    /// unused by "`touch_center`"
    #[option(range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub tip_radius_m: f64,
}

/// The device for training.
///
/// Equal arguments give equal bytes only on the CPU. Other devices use the plain point network, in
/// `f32`: a step's features and gradients agree within 1e-4 of each array's largest value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrainingDevice {
    /// The processor.
    #[default]
    Cpu,
    /// The first NVIDIA graphics processor.
    Cuda,
    /// The first graphics processor of a Mac.
    Metal,
}

/// Decay of the learning rate over the epochs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Halved every `halving_epochs` epochs.
    Halving,
    /// Half a cosine from the start down to zero (Loshchilov and Hutter, *SGDR*, 2017, eq. 5).
    #[default]
    Cosine,
}

/// Rotation of object and hand together about the object's origin.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Augmentation {
    /// Not at all: the object keeps its resting orientation.
    None,
    /// About the vertical, redrawn for every object and step: gravity keeps its direction.
    #[default]
    Vertical,
    /// By eleven rotations that are sampled once for each motion, the identity among them; an epoch
    /// covers all of them.
    Released,
    /// By any rotation, redrawn for every object and step: the network does not know where down is.
    Any,
}

/// Units of the network's outputs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outputs {
    /// Meters, matrix entries and radians.
    Physical,
    /// The same less their mean, over the standard deviation of translation, rotation and joints.
    #[default]
    Standardized,
}

/// Target of the contact loss for the fingertips at the grasp.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Contact {
    /// Their centers lie on the object's points, as in the paper.
    TouchCenter,
    /// Their surfaces touch the object's points.
    #[default]
    TouchSurface,
    /// None: the loss is the distance of the demonstration's fingertips from the object's points, which
    /// does not depend on the weights, as in the released code.
    Demonstrated,
}

/// Distribution of the further times of a motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Times {
    /// Anywhere, redrawn in every epoch: positions between two steps are interpolated linearly,
    /// rotations along the shortest arc.
    #[default]
    Continuous,
    /// On recorded steps, sampled once for each motion.
    Recorded,
}

/// Draws of a latent code's noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatentNoise {
    /// Once for a motion, as in sampling.
    #[default]
    PerMotion,
    /// Again at every time of a motion.
    PerTime,
}

/// Initialization of the weights.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Initialization {
    /// Variance `1 / inputs`, no bias, a small last layer, object features near zero.
    #[default]
    Centered,
    /// Weights and biases uniform within `1 / sqrt(inputs)`, as `PyTorch` does.
    Torch,
}

/// Reduction of squared errors over times, outputs, links and fingertips; over motions it is always
/// the mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reduction {
    /// Their mean.
    #[default]
    Mean,
    /// Their sum.
    Sum,
}

impl Initialization {
    /// Returns the bound of uniform weights of a layer with this many inputs.
    pub(crate) fn bound(self, inputs: usize) -> f64 {
        match self {
            // Variance 1 / inputs (LeCun et al., *Efficient BackProp*, 1998, §4.6).
            Self::Centered => (3.0 / inputs as f64).sqrt(),
            Self::Torch => (1.0 / inputs as f64).sqrt(),
        }
    }
}

impl TrainingDevice {
    /// Opens the device.
    pub(crate) fn open(self) -> Result<Device, CgfError> {
        let (device, feature, is_built) = match self {
            Self::Cpu => return Ok(Device::Cpu),
            Self::Cuda => (Device::new_cuda(0), "cuda", cfg!(feature = "cuda")),
            Self::Metal => (Device::new_metal(0), "metal", cfg!(feature = "metal")),
        };
        if is_built {
            Ok(device?)
        } else {
            Err(CgfError::NotBuiltFor { feature })
        }
    }
}

impl NetworkConfig {
    /// Returns the encoder's input dimension per step for a hand of `dof` joints.
    pub(crate) fn encoder_inputs(&self, dof: usize) -> usize {
        match self.encoder_rotation {
            EncoderRotation::Columns => PALM_WIDTH + dof,
            EncoderRotation::AxisAngle => PALM_WIDTH - 3 + dof,
        }
    }

    fn width_faults(&self, faults: &mut OptionFaults) {
        let parts = [
            ("point_widths", &self.point_widths),
            ("hand_widths", &self.hand_widths),
            ("encoder_widths", &self.encoder_widths),
            ("decoder_widths", &self.decoder_widths),
            ("local_widths", &self.local_widths),
        ];
        for (key, widths) in parts {
            let is_width = |width: &usize| (1..=MAX_WIDTH).contains(width);
            if !(1..=MAX_LAYERS).contains(&widths.len()) || !widths.iter().all(is_width) {
                let problem = format!(
                    "is {widths:?}, and must be 1 to {MAX_LAYERS} widths from 1 to {MAX_WIDTH}: {OF_WIDTHS}"
                );
                faults.note(key, problem);
            }
        }
        let weights_n = self.weight_count();
        if !faults.is_empty() || weights_n <= MAX_WEIGHTS {
            return;
        }
        let widest = parts
            .into_iter()
            .max_by_key(|(_, widths)| widths.iter().max());
        let (key, widths) = widest.unwrap_or(("decoder_widths", &self.decoder_widths));
        let problem = format!(
            "is {widths:?}, and must be less: the network has {weights_n} weights and may have \
             {MAX_WEIGHTS}, of which five numbers each are held in memory"
        );
        faults.note(key, problem);
    }

    /// Returns the approximate number of weights; those of a hand's joints are not counted.
    fn weight_count(&self) -> usize {
        let feature = last(&self.point_widths);
        let motion = last(&self.hand_widths).saturating_mul(self.encoder_steps);
        [
            layers(3, &self.point_widths),
            layers(PALM_WIDTH, &self.hand_widths),
            layers(motion.saturating_add(feature), &self.encoder_widths),
            last(&self.encoder_widths).saturating_mul(2 * self.latent_dim),
            layers(
                feature.saturating_add(self.latent_dim),
                &self.decoder_widths,
            ),
            layers(
                if self.local_points > 0 {
                    basis_points::width(self.local_points, 0) + feature + self.latent_dim
                } else {
                    0
                },
                &self.local_widths,
            ),
        ]
        .into_iter()
        .fold(0, usize::saturating_add)
    }
}

/// Returns the number of weights of layers of these widths, one on another.
fn layers(inputs: usize, widths: &[usize]) -> usize {
    let below = std::iter::once(&inputs).chain(widths);
    let products = below.zip(widths).map(|(a, b)| a.saturating_mul(*b));
    products.fold(0, usize::saturating_add)
}

fn last(widths: &[usize]) -> usize {
    widths.last().copied().unwrap_or(0)
}

impl TrainingConfig {
    /// Checks that a step of training this network can be held in memory.
    ///
    /// # Errors
    ///
    /// Fails if it cannot.
    pub fn check_memory(&self, network: &NetworkConfig) -> Result<(), OptionFault> {
        let sum = |widths: &[usize]| widths.iter().copied().fold(0, usize::saturating_add);
        let times = self.grasp_steps.saturating_add(self.random_times);
        let of_motion = [
            network.points.saturating_mul(sum(&network.point_widths)),
            network
                .encoder_steps
                .saturating_mul(sum(&network.hand_widths)),
            times.saturating_mul(sum(&network.decoder_widths)),
            times.saturating_mul(if network.local_points > 0 {
                sum(&network.local_widths)
            } else {
                0
            }),
        ];
        let of_motion = of_motion.into_iter().fold(0, usize::saturating_add);
        let numbers = of_motion.saturating_mul(self.batch);
        if numbers <= MAX_ACTIVATIONS {
            return Ok(());
        }
        let most = (MAX_ACTIVATIONS / of_motion.max(1)).max(1);
        let problem = format!(
            "is {}, and must be at most {most} with this network: a step holds 4 bytes for each output of \
             each layer, here {:.0} GB of at most {:.0} GB",
            self.batch,
            numbers as f64 * 4e-9,
            MAX_ACTIVATIONS as f64 * 4e-9
        );
        Err(OptionFault::new("batch", problem))
    }

    /// Returns the learning rate of an epoch, counted from 0.
    pub(crate) fn learning_rate_of(&self, epoch: usize) -> f64 {
        let share = epoch as f64 / self.epochs as f64;
        let factor = match self.schedule {
            Schedule::Halving => 0.5_f64.powf((epoch / self.halving_epochs) as f64),
            Schedule::Cosine => 0.5 * (1.0 + (std::f64::consts::PI * share).cos()),
        };
        self.learning_rate * factor
    }
}
