//! Options of `kind = "eigengrasp"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most grasps of one object.
const MAX_GRASPS: usize = 100_000;
/// Most steps of one run.
const MAX_STEPS: usize = 100_000_000;
/// Most runs for one object.
const MAX_RUNS: usize = 10_000;
/// Most states of a run that are kept.
const MAX_KEPT: usize = 1000;
/// Most eigengrasps: no hand has more joints.
const MAX_EIGENGRASPS: usize = 64;
/// Greatest friction coefficient.
const MAX_FRICTION: f64 = 10.0;
/// Farthest that a palm backs off, in meters.
const MAX_BACK_OFF_M: f64 = 1.0;

/// Options of `kind = "eigengrasp"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EigengraspConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Grasps per object, the best of all runs: as many as the motions of `sample`
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
    /// Runs per object, each with the object in a resting pose of its own: as many as fill `per_object`
    #[serde(default = "defaults::runs")]
    pub runs: usize,
    /// Steps of each run, the published budget
    #[serde(default = "defaults::steps")]
    pub steps: usize,
    /// States of each run that are finished, the best that differ: `GraspIt`'s number
    #[serde(default = "defaults::kept")]
    pub kept: usize,
    /// Number of eigengrasps: the published one
    #[serde(default = "defaults::eigengrasps")]
    pub eigengrasps: usize,
    /// Greatest amplitude of an eigengrasp, either way, in standard deviations of the grasps it comes from (1)
    #[serde(default = "defaults::max_amplitude")]
    pub max_amplitude: f64,
    /// Distance by which a kept hand backs off before it advances until it touches (m)
    #[serde(default = "defaults::back_off_m")]
    pub back_off_m: f64,
    /// Friction coefficient of the contacts by which grasps are ranked: that of `force_closure`
    #[serde(default = "defaults::friction")]
    pub friction: f64,
    /// The way to the grasp, and how the object lies
    #[serde(default)]
    pub approach: ApproachConfig,
}

impl EigengraspConfig {
    /// Returns the faults of the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "each is finished, ranked and simulated";
        faults.within("per_object", self.per_object, 1..=MAX_GRASPS, why);
        let why = "each takes seconds";
        faults.within("runs", self.runs, 1..=MAX_RUNS, why);
        let why = "each places the hand and measures its contacts";
        faults.within("steps", self.steps, 1..=MAX_STEPS, why);
        let why = "each is compared with every new state";
        faults.within("kept", self.kept, 1..=MAX_KEPT, why);
        let why = "a hand has no more components than joints";
        faults.within("eigengrasps", self.eigengrasps, 1..=MAX_EIGENGRASPS, why);
        let why = "no grasp is farther from the mean";
        faults.within("max_amplitude", self.max_amplitude, 0.0..=100.0, why);
        let why = "an object is no farther away";
        faults.within("back_off_m", self.back_off_m, 0.0..=MAX_BACK_OFF_M, why);
        let why = "no force is across a surface without friction, and no material has more";
        faults.above("friction", self.friction, 0.0, MAX_FRICTION, why);
        if self.flexion_joints.is_empty() {
            faults.note("flexion_joints", "is empty, and fingers close with them");
        }
        faults.of_table("approach", self.approach.faults());
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn per_object() -> usize { 64 }
    pub(super) fn runs() -> usize { 4 }
    pub(super) fn steps() -> usize { 70_000 }
    pub(super) fn kept() -> usize { 20 }
    pub(super) fn eigengrasps() -> usize { 2 }
    pub(super) fn max_amplitude() -> f64 { 3.0 }
    pub(super) fn back_off_m() -> f64 { 0.015 }
    pub(super) fn friction() -> f64 { 0.7 }
}
