//! Options of `kind = "sample"`.

use std::path::PathBuf;

use nalgebra::{Unit, Vector3};
use options::{OptionFaults, above, options};
use sampling::{Orientations, SamplingOptions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most motions of one object, a hundred times the paper's.
const MAX_MOTIONS: usize = 1_000_000;
/// Most steps of a motion: ten seconds at a controller's 1000 Hz.
const MAX_STEPS: usize = 10_000;
/// Most steps of all motions of one object, ten times the paper's: 4 GB.
const MAX_STEPS_HELD: usize = 4_000_000;
/// Most codes sampled for one motion.
const MAX_DRAWS: usize = 10_000;
/// Longest motion, in seconds.
const MAX_DURATION_S: f64 = 3600.0;
/// Greatest factor on a deviation, and greatest share of an extent.
const MAX_FACTOR: f64 = 1000.0;
/// Greatest depth, in meters.
const MAX_DEPTH_M: f64 = 10.0;
/// Most motions side by side.
const MAX_RECORDED: usize = 1000;

/// Options of `kind = "sample"`.
#[options(also = Self::combined_faults)]
pub struct SampleConfig {
    /// File of the robot hand, or its URDF alone; its collision shapes are measured against object and table
    #[option(path)]
    pub hand: PathBuf,
    /// Weights of the checkpoint: the last, because the held-out loss hardly rises
    /// when the learning rate falls to zero
    #[option(default)]
    pub epoch: CheckpointWeights,
    /// Objects that get motions, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Motions per object: enough for a success rate within 12 points; paper: 10000
    #[option(default = 64, range = 1..=MAX_MOTIONS, why = "each motion costs time and disk space")]
    pub per_object: usize,
    /// Steps of each motion, at equal times, at least 2: the paper's
    #[option(
        default = 40, range = 2..=MAX_STEPS,
        why = "a motion needs two steps, and the upper limit is ten seconds at 1000 Hz"
    )]
    pub steps: usize,
    /// Time from the first step to the grasp, s: a person's reach takes about as long
    #[option(
        default = 1.5, range = above(0.0, MAX_DURATION_S),
        why = "reaching for an object takes seconds"
    )]
    pub duration_s: f64,
    /// Share of the motions whose latent code is sampled from a demonstration's posterior, in 0..=1, the
    /// others from the function's prior: half seen grasps, half new ones; paper: 0
    #[option(default = 0.5, range = 0.0..=1.0, why = "it is a share")]
    pub demonstrated_share: f64,
    /// Names of these demonstrations, of any object; empty: all training demonstrations of the same
    /// object
    #[option(default)]
    pub demonstrations: Vec<String>,
    /// Factor on the standard deviation of sampled codes: the distribution itself, as in the paper
    #[option(
        default = 1.0, range = 0.0..=MAX_FACTOR,
        why = "it scales a standard deviation of 1, and no training code is farther out"
    )]
    pub spread: f64,
    /// Most latent codes sampled for a motion until its hand stays out of object and table; if none does,
    /// the shallowest is kept; refused samples are rows of `draws`. One: motions are refined
    /// instead; paper: 1
    #[option(
        default = 1, range = 1..=MAX_DRAWS,
        why = "each sample is decoded and checked for penetration"
    )]
    pub draws: usize,
    /// Tolerated penetration of object or table (m): as deep as a squeeze presses; unused if `draws`
    /// is 1
    #[option(
        default = 0.004, range = 0.0..=MAX_DEPTH_M,
        why = "no object that a hand can hold is deeper"
    )]
    pub max_depth_m: f64,
    /// Names of two demonstrations: latent codes are not sampled but go from the one's mean to the
    /// other's in equal steps, in the first one's resting orientation; empty: they are sampled
    #[option(default)]
    pub path: Vec<String>,
    /// Resting orientations of the object: those that people grasp it in
    #[option(default)]
    pub rests: RestingPoses,
    /// Unit vector against gravity, object frame, for `rests = "given"`
    #[option(default)]
    pub rest_up: Option<[f64; 3]>,
    /// Noise on the object's points, for a study: normally distributed and new for each motion, with a standard
    /// deviation along each axis of this share of the object's extent (0); paper: 0 to 1
    #[option(default, range = 0.0..=MAX_FACTOR, why = "it is a share of the object's extent")]
    pub point_noise: f64,
    /// Whose shape the function sees, for a study: that of the object itself, or of the next one by name
    #[option(default)]
    pub shape: SeenShape,
    /// Motions per object that are shown side by side in one recording for a viewer (0)
    #[option(
        default, range = 0..=MAX_RECORDED,
        why = "they are shown side by side in one recording"
    )]
    pub recorded_per_object: usize,
}

/// Resting orientations of an object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RestingPoses {
    /// Those of its demonstrations, as often as they were seen; of an object that the function was not
    /// trained on, those that are `stable`.
    #[default]
    Seen,
    /// Those of its demonstrations, also of an object that the function was not trained on: for a comparison
    /// with generators that know them.
    Recorded,
    /// Those that are stable, as probable as they are by the mesh.
    Stable,
    /// The one of `rest_up`, with the mesh's lowest point on the table.
    Given,
}

/// Whose shape the function sees.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeenShape {
    /// That of the object.
    #[default]
    Own,
    /// That of the next object by name, as it rests most often; the motion is placed about the object all
    /// the same.
    Other,
}

impl SampleConfig {
    /// Says whether motions are redrawn if their hand penetrates object or table.
    pub(crate) fn redraws(&self) -> bool {
        self.draws > 1 && self.path.is_empty()
    }

    /// Returns the options of sampling.
    pub(crate) fn sampling(&self) -> SamplingOptions {
        let path = match self.path.as_slice() {
            [from, to] => Some([from.clone(), to.clone()]),
            _ => None,
        };
        let orientations = match (self.rests, self.rest_up) {
            (RestingPoses::Given, Some(up)) => {
                Orientations::Given(Unit::new_normalize(Vector3::from(up)))
            }
            (RestingPoses::Recorded, _) => Orientations::Recorded,
            (RestingPoses::Stable, _) => Orientations::Stable,
            (RestingPoses::Seen | RestingPoses::Given, _) => Orientations::Seen,
        };
        SamplingOptions {
            n: self.per_object,
            steps: self.steps,
            duration_s: self.duration_s,
            posterior_share: self.demonstrated_share,
            demonstrations: self.demonstrations.clone(),
            spread: self.spread,
            path,
            orientations,
            point_noise: self.point_noise,
        }
    }

    fn combined_faults(&self, faults: &mut OptionFaults) {
        if !self.path.is_empty() && self.per_object == 1 {
            faults.note(
                "per_object",
                "is 1, and must be at least 2: a path needs its two ends",
            );
        }
        let steps = self.per_object.saturating_mul(self.steps);
        if self.per_object <= MAX_MOTIONS && self.steps <= MAX_STEPS && steps > MAX_STEPS_HELD {
            let problem = format!(
                "is {}, with `steps` = {} that makes {steps} steps per object, and may make \
                 {MAX_STEPS_HELD}: they are held in memory together, about 1 kB each",
                self.per_object, self.steps
            );
            faults.note("per_object", problem);
        }
        if !matches!(self.path.len(), 0 | 2) {
            let problem = format!("is {:?}, and must be two names or none", self.path);
            faults.note("path", problem);
        }
        match (self.rests, self.rest_up) {
            (RestingPoses::Given, None) => {
                let problem = "is missing, and `rests = \"given\"` asks for a unit vector";
                faults.note("rest_up", problem);
            }
            (RestingPoses::Given, Some([x, y, z])) => {
                let length = (x * x + y * y + z * z).sqrt();
                // A length that is no number is not near 1 either.
                let is_unit = (length - 1.0).abs() < 1e-3;
                if !is_unit {
                    let problem = format!("is {:?}, and must be a unit vector", [x, y, z]);
                    faults.note("rest_up", problem);
                }
            }
            (_, Some(_)) => {
                let problem = "is to be left out without `rests = \"given\"`";
                faults.note("rest_up", problem);
            }
            (_, None) => {}
        }
    }
}

/// Weights of a checkpoint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CheckpointWeights {
    /// Those with the least loss on held-out motions.
    Best,
    /// Those after the last epoch.
    #[default]
    Last,
}
