//! Options of `kind = "screen"`.

use std::path::PathBuf;

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use schemas::rollouts::Verdict;
use serde::{Deserialize, Serialize};
use simulation::{Protocol, Rollout, SceneConfig, SceneRandomization};

/// Most rollouts of an object that are recorded: a recording has about 1 MB.
const MAX_RECORDED: usize = 10_000;
/// Largest pose noise, as a share of an object's extent.
const MAX_POSE_NOISE: f64 = 1000.0;

/// Most trials of a motion under sampled errors.
const MAX_TRIALS: usize = 100_000;
/// Most motions of an object that are tried under sampled errors.
const MAX_TRIED: usize = 1_000_000;

/// Greatest bound of the hand's depth in an object, in meters.
const MAX_PENETRATION_M: f64 = 1.0;

/// Options of `kind = "screen"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScreenConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Number of accepted rollouts per object recorded for a viewer: a recording has about 1 MB.
    #[serde(default = "defaults::recorded_per_object")]
    pub recorded_per_object: usize,
    /// Number of failed rollouts per object recorded likewise, the first of each reason before a second
    /// of any; a motion refused on geometry alone, or whose simulation diverged, has none.
    #[serde(default = "defaults::recorded_failures_per_object")]
    pub recorded_failures_per_object: usize,
    /// Noise on the object's position, for a study: each motion is executed as if the object were
    /// shifted by normally distributed lengths, with a standard deviation along each axis of this
    /// share of the object's extent (0); paper: 0 to 0.1
    #[serde(default)]
    pub pose_noise: f64,
    /// Deepest that the hand may be in an object that it holds, in meters; deeper is `too_deep`: soft
    /// fingertips yield by that much.
    #[serde(default = "defaults::max_penetration_m")]
    pub max_penetration_m: f64,
    /// Trials of accepted motions under sampled errors.
    #[serde(default)]
    pub robustness: RobustnessConfig,
    /// The physical scene.
    pub scene: SceneConfig,
    /// Execution of a motion and its conditions of success.
    pub protocol: Protocol,
}

/// Trials of accepted motions under sampled errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct RobustnessConfig {
    /// Number of trials of each motion (16), 0 for none: its share of them is uncertain by an eighth.
    pub trials: usize,
    /// Number of accepted motions per object that are tried, the first ones (16): each costs as much as
    /// `trials` candidates.
    pub per_object: usize,
    /// Bounds of the sampled errors.
    pub errors: SceneRandomization,
}

impl Default for RobustnessConfig {
    fn default() -> Self {
        Self {
            trials: 16,
            per_object: 16,
            errors: SceneRandomization::default(),
        }
    }
}

impl ScreenConfig {
    /// Returns the verdict on a rollout: physics alone lets a hand hold an object by being inside it.
    pub fn verdict(&self, rollout: &Rollout) -> Verdict {
        match rollout.verdict {
            Verdict::Held if rollout.penetration_m > self.max_penetration_m => Verdict::TooDeep,
            verdict => verdict,
        }
    }

    /// Returns the options for which the protocol's name stands: a published one judges no depth.
    #[must_use]
    pub fn resolved(&self) -> Self {
        let (scene, protocol) = self.protocol.resolved(&self.scene);
        let max_penetration_m = if self.protocol.name.is_table_lift() {
            self.max_penetration_m
        } else {
            f64::INFINITY
        };
        Self {
            max_penetration_m,
            scene,
            protocol,
            ..self.clone()
        }
    }

    /// Returns what is wrong with the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        for (key, recorded) in [
            ("recorded_per_object", self.recorded_per_object),
            (
                "recorded_failures_per_object",
                self.recorded_failures_per_object,
            ),
        ] {
            let why = "each recording takes about 1 MB";
            faults.within(key, recorded, 0..=MAX_RECORDED, why);
        }
        let why = "it is a share of the object's extent";
        faults.within("pose_noise", self.pose_noise, 0.0..=MAX_POSE_NOISE, why);
        let why = "no object of a hand's size is deeper";
        let depth_m = self.max_penetration_m;
        faults.within("max_penetration_m", depth_m, 0.0..=MAX_PENETRATION_M, why);
        let RobustnessConfig {
            trials,
            per_object,
            errors,
        } = &self.robustness;
        let why = "each simulates every tried motion once more";
        faults.within("robustness.trials", *trials, 0..=MAX_TRIALS, why);
        let why = "each is simulated `robustness.trials` times";
        faults.within("robustness.per_object", *per_object, 0..=MAX_TRIED, why);
        faults.of_table("robustness.errors", errors.faults(&self.scene));
        faults.of_table("scene", self.scene.faults());
        faults.of_table("protocol", self.protocol.faults(&self.scene));
        if !self.protocol.name.is_table_lift() {
            let Self {
                scene, protocol, ..
            } = self.resolved();
            faults.of_table("scene", scene.faults());
            faults.of_table("protocol", protocol.faults(&scene));
        }
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn recorded_per_object() -> usize { 2 }
    pub(super) fn recorded_failures_per_object() -> usize { 1 }
    pub(super) fn max_penetration_m() -> f64 { 0.005 }
}

/// Options of a screen for a hand with a joint `j`, for tests.
#[cfg(test)]
pub(crate) fn fixture() -> ScreenConfig {
    let config = serde_json::json!({
        "hand": "hand.urdf",
        "scene": {"drive": {
            "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
        }},
        "protocol": {"flexion_joints": ["j"]},
    });
    serde_json::from_value(config).unwrap()
}
