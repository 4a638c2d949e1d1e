//! Options of `kind = "eigengrasp"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use options::{OptionFaults, above, options};

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
#[options(also = Self::combined_faults)]
pub struct EigengraspConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[option(path)]
    pub hand: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Grasps per object, the best of all runs: as many as the motions of `sample`
    #[option(default = 64, range = 1..=MAX_GRASPS, why = "each is finished, ranked and simulated")]
    pub per_object: usize,
    /// Runs per object, each with the object in a resting pose of its own: as many as fill `per_object`
    #[option(default = 4, range = 1..=MAX_RUNS, why = "each takes seconds")]
    pub runs: usize,
    /// Steps of each run, the published budget
    #[option(
        default = 70_000, range = 1..=MAX_STEPS,
        why = "each places the hand and measures its contacts"
    )]
    pub steps: usize,
    /// States of each run that are finished, the best that differ: `GraspIt`'s number
    #[option(default = 20, range = 1..=MAX_KEPT, why = "each is compared with every new state")]
    pub kept: usize,
    /// Number of eigengrasps: the published one
    #[option(
        default = 2, range = 1..=MAX_EIGENGRASPS,
        why = "a hand has no more components than joints"
    )]
    pub eigengrasps: usize,
    /// Greatest amplitude of an eigengrasp, either way, in standard deviations of the grasps it comes from (1)
    #[option(default = 3.0, range = 0.0..=100.0, why = "no grasp is farther from the mean")]
    pub max_amplitude: f64,
    /// Distance by which a kept hand backs off before it advances until it touches (m)
    #[option(default = 0.015, range = 0.0..=MAX_BACK_OFF_M, why = "an object is no farther away")]
    pub back_off_m: f64,
    /// Friction coefficient of the contacts by which grasps are ranked: that of `force_closure`
    #[option(
        default = 0.7, range = above(0.0, MAX_FRICTION),
        why = "no force is across a surface without friction, and no material has more"
    )]
    pub friction: f64,
    /// The way to the grasp, and how the object lies
    #[option(default, table)]
    pub approach: ApproachConfig,
}

impl EigengraspConfig {
    fn combined_faults(&self, faults: &mut OptionFaults) {
        if self.flexion_joints.is_empty() {
            faults.note("flexion_joints", "is empty, and fingers close with them");
        }
    }
}
