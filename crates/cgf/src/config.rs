//! What can be chosen about the network and its training.

use candle_core::Device;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{CgfError, grasp::ROOT};

/// Widths and shapes of the network (section III-B of the paper; `README.md` names the tensors).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// Surface points of the object that the network sees; paper: 2000
    pub points: usize,
    /// Widths of the point network's layers, the last is the object feature's; paper: [64, 128, 1024]
    pub point_widths: Vec<usize>,
    /// Steps of a motion that the encoder sees; released code: 20
    pub encoder_steps: usize,
    /// Widths of the layers applied to each of these steps; released code: [256, 64]
    pub hand_widths: Vec<usize>,
    /// Widths of the encoder's layers before mean and variance; released code: `[256]`
    pub encoder_widths: Vec<usize>,
    /// Width of the latent code z; paper: 256
    pub latent_dim: usize,
    /// Widths of the decoder's hidden layers; paper: [512, 256], released code: [256, 512, 256]
    pub decoder_widths: Vec<usize>,
    /// Activation of encoder and decoder; paper: "relu", which has no second derivative in time
    pub activation: Activation,
    /// Frame in which the network sees object and hand; paper: "object"
    pub frame: Frame,
    /// Which steps of a motion the encoder sees; released code: "recorded"
    pub encoder_times: EncoderTimes,
    /// How the encoder sees the palm's rotation; released code: "`axis_angle`"
    pub encoder_rotation: EncoderRotation,
    /// How uncertain the encoder can be of a motion's code; paper: "free"
    pub latent_variance: LatentVariance,
    /// Where the decoder's joint positions can be; paper: "free"
    pub joints: JointOutputs,
}

/// The frame in which the network sees object and hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// The table under the object as it lies, z against gravity: the network knows where the table is.
    Resting,
    /// The object's own: equal motions about an object are equal however it lies.
    Object,
}

/// Which steps of a motion the encoder sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EncoderTimes {
    /// Steps at equal times from the first to the grasp.
    Equal,
    /// Recorded ones, drawn once for each motion.
    Recorded,
}

/// How the encoder sees the palm's rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EncoderRotation {
    /// As the first two columns of its matrix.
    Columns,
    /// As axis times angle, which jumps at a half turn.
    AxisAngle,
}

/// How uncertain the encoder can be of a motion's code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatentVariance {
    /// The encoder gives the logarithm of any variance: for a motion unlike all others it can be so
    /// large that one step spoils a training.
    Free,
    /// Its variance is at most the prior's, which is 1: `sigmoid(x)` of the last layer's x.
    BelowPrior,
}

/// Where the decoder's joint positions can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JointOutputs {
    /// Anywhere.
    Free,
    /// Within the hand's limits: `middle + half · tanh((x − middle) / half)` of the last layer's x, where
    /// `half` is half of the joint's range.
    WithinLimits,
}

/// What stands between two layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// `max(x, 0)`: motions are piecewise linear in time before the rotation map.
    Relu,
    /// `x / (1 + exp(−x))`: motions have velocities and accelerations.
    Silu,
}

/// How a network is trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig {
    /// What computes, "cpu" if absent; "cuda" and "metal" need a program built with that feature
    #[serde(default)]
    pub device: TrainingDevice,
    /// Passes over all trajectories; paper: 1000
    pub epochs: usize,
    /// Epochs between two measurements of held-out motions; the last epoch always measures
    pub validation_epochs: usize,
    /// Trajectories per step of the optimizer; paper: 32
    pub batch: usize,
    /// Adam's learning rate at the start; paper: 5e-4
    pub learning_rate: f64,
    /// Gradients longer than this are shortened to it; absent: never, as in the paper
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_gradient_norm: Option<f64>,
    /// How the learning rate falls; paper: "halving"
    pub schedule: Schedule,
    /// Epochs after which `schedule = "halving"` halves the learning rate; paper: 500
    pub halving_epochs: usize,
    /// Last steps of every motion that are always seen; released code: 5
    pub grasp_steps: usize,
    /// Weight of each of these in the losses, where every other time has 1; paper: 1
    pub grasp_weight: f64,
    /// Further times of every motion, drawn anew each epoch; released code: 20
    pub random_times: usize,
    /// Where these further times lie; released code: "recorded"
    pub times: Times,
    /// How often the noise of a latent code is drawn; released code: "`per_time`"
    pub latent_noise: LatentNoise,
    /// How the first weights are drawn; released code: "torch"
    pub initialization: Initialization,
    /// How object and hand are turned together during training; released code: "released"
    pub augmentation: Augmentation,
    /// Units in which the network speaks and the position loss is measured; paper: "physical"
    pub outputs: Outputs,
    /// Share of the epochs after which the point network's statistics stay fixed; paper: 1
    pub fixed_statistics_after: f64,
    /// How squared errors are put together; paper: "sum"
    pub reduction: Reduction,
    /// Weight of the outputs' squared errors, in the units of `outputs`; paper: 1
    pub q_weight: f64,
    /// Weight of the translation's squared errors, in the units of `outputs`, beside `q_weight`;
    /// paper: 0, released code: 10
    pub translation_weight: f64,
    /// Weight of the link origins' squared distances, 1/m²; paper: 10
    pub origins_weight: f64,
    /// Weight of the squared errors of the first two columns of the links' rotations; paper: 0,
    /// released code: 0.5
    pub rotations_weight: f64,
    /// Weight of the latent code's divergence from the standard normal, 1/nat; paper: 1e-3
    pub kl_weight: f64,
    /// Weight of the finger tips' squared distances from contact, 1/m²; paper: 50
    pub contact_weight: f64,
    /// Weight of the squared depths of the links in object and table, 1/m²; paper: 0
    pub penetration_weight: f64,
    /// What the contact loss asks of the finger tips at the grasp; paper: "`touch_center`"
    pub contact: Contact,
    /// Names of the hand's finger tip links
    pub tips: Vec<String>,
    /// Radius of the finger tips about their links' origins, m; unused by "`touch_center`"
    pub tip_radius_m: f64,
}

/// What a network is trained on.
///
/// Equal arguments give equal bytes on the CPU alone. Elsewhere the point network is the plain one, in
/// `f32`: a step's features and gradients are the same within 1e-4 of each array's largest.
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

/// How the learning rate falls over the epochs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Halved every `halving_epochs` epochs.
    Halving,
    /// Half a cosine from the start down to zero (Loshchilov and Hutter, *SGDR*, 2017, eq. 5).
    Cosine,
}

/// How object and hand are turned together about the object's origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Augmentation {
    /// Not at all: the object always lies as its resting orientation puts it.
    None,
    /// About the vertical, anew for every object and step: gravity stays where it is.
    Vertical,
    /// By eleven rotations that are drawn once for each motion, no rotation among them; an epoch goes
    /// through all of them.
    Released,
    /// By any rotation, anew for every object and step: the network does not know where down is.
    Any,
}

/// Units of the network's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outputs {
    /// Meters, matrix entries and radians.
    Physical,
    /// The same less their mean, over the standard deviation of translation, rotation and joints.
    Standardized,
}

/// What the contact loss asks of the finger tips at the grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Contact {
    /// That their centers lie on the object's points, as the paper prints it.
    TouchCenter,
    /// That their surfaces touch the object's points.
    TouchSurface,
    /// Nothing: it says how far the demonstration's tips are from the object's points, which no weight
    /// changes, as the released code has it.
    Demonstrated,
}

/// Where the further times of a motion lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Times {
    /// Anywhere, drawn anew in every epoch: positions between two steps lie on a line, rotations on the
    /// shortest arc.
    Continuous,
    /// On recorded steps, drawn once for each motion.
    Recorded,
}

/// How often the noise of a latent code is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatentNoise {
    /// Once for a motion, as in sampling.
    PerMotion,
    /// Anew at every time of a motion.
    PerTime,
}

/// How the first weights are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Initialization {
    /// Variance `1 / inputs`, no bias, the last layer small, object features about zero.
    Centered,
    /// Weights and biases uniform within `1 / sqrt(inputs)`, as `PyTorch` does.
    Torch,
}

/// How squared errors are put together over times, outputs, links and finger tips; over motions it is
/// always the mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reduction {
    /// Their mean.
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
    /// Returns how many numbers the encoder sees of a step of a hand of `dof` joints.
    pub(crate) fn encoder_inputs(&self, dof: usize) -> usize {
        match self.encoder_rotation {
            EncoderRotation::Columns => ROOT + dof,
            EncoderRotation::AxisAngle => ROOT - 3 + dof,
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Names the first one that cannot be used.
    pub fn check(&self) -> Result<(), CgfError> {
        let positive = |key, value: usize| check(key, value, value > 0, "a positive number");
        let widths = |key, widths: &[usize]| {
            let usable = !widths.is_empty() && widths.iter().all(|&width| width > 0);
            check(
                key,
                format!("{widths:?}"),
                usable,
                "at least one positive width",
            )
        };
        check(
            "points",
            self.points,
            self.points >= 32,
            "at least 32 points",
        )?;
        widths("point_widths", &self.point_widths)?;
        positive("encoder_steps", self.encoder_steps)?;
        widths("hand_widths", &self.hand_widths)?;
        widths("encoder_widths", &self.encoder_widths)?;
        positive("latent_dim", self.latent_dim)?;
        widths("decoder_widths", &self.decoder_widths)
    }
}

impl TrainingConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// Names the first one that cannot be used.
    pub fn check(&self) -> Result<(), CgfError> {
        let positive = |key, value: usize| check(key, value, value > 0, "a positive number");
        let not_negative = |key, value: f64| {
            let usable = value.is_finite() && value >= 0.0;
            check(key, value, usable, "a number that is not negative")
        };
        positive("epochs", self.epochs)?;
        positive("validation_epochs", self.validation_epochs)?;
        positive("batch", self.batch)?;
        positive("halving_epochs", self.halving_epochs)?;
        positive("grasp_steps", self.grasp_steps)?;
        not_negative("learning_rate", self.learning_rate)?;
        not_negative("grasp_weight", self.grasp_weight)?;
        if let Some(norm) = self.max_gradient_norm {
            check("max_gradient_norm", norm, norm > 0.0, "more than 0")?;
        }
        not_negative("fixed_statistics_after", self.fixed_statistics_after)?;
        not_negative("tip_radius_m", self.tip_radius_m)?;
        not_negative("q_weight", self.q_weight)?;
        not_negative("translation_weight", self.translation_weight)?;
        not_negative("rotations_weight", self.rotations_weight)?;
        not_negative("origins_weight", self.origins_weight)?;
        not_negative("kl_weight", self.kl_weight)?;
        not_negative("contact_weight", self.contact_weight)?;
        not_negative("penetration_weight", self.penetration_weight)
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

fn check(
    key: &'static str,
    value: impl std::fmt::Display,
    usable: bool,
    expected: &'static str,
) -> Result<(), CgfError> {
    if usable {
        Ok(())
    } else {
        Err(CgfError::Config {
            key,
            value: value.to_string(),
            expected,
        })
    }
}
