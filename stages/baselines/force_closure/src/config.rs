//! Options of `kind = "force_closure"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most grasps of one object.
const MAX_GRASPS: usize = 100_000;
/// Most iterations of one search.
const MAX_ITERATIONS: usize = 100_000;
/// Most searches for one grasp.
const MAX_SEARCHES: usize = 10_000;
/// Largest weight: its squares still add up accurately.
const MAX_WEIGHT: f64 = 1e6;
/// Greatest friction coefficient.
const MAX_FRICTION: f64 = 10.0;
/// Most edges of a linearized cone: the program to solve grows with them.
const MAX_EDGES: usize = 32;
/// Greatest length that a tolerance makes sense of, in meters.
const MAX_TOLERANCE_M: f64 = 0.1;

/// Options of `kind = "force_closure"`.
///
/// A weight multiplies its residual before it is squared.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceClosureConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The hand's file: which points of the hand are fingertips, and their radii
    #[serde(skip_serializing)]
    pub hand_table: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Grasps per object: as many as the motions of `sample`
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
    /// Maximum number of iterations of one search, each an evaluation of the metric and its gradient, over all its
    /// rounds; 0: random palms whose fingers close; published: 1000, of a solver that takes shorter steps
    #[serde(default = "defaults::max_iterations")]
    pub max_iterations: usize,
    /// Most searches for one grasp until one ends as it should; if none does, the one that comes nearest is kept;
    /// published: as many as it takes, within 60 s
    #[serde(default = "defaults::searches")]
    pub searches: usize,
    /// Friction coefficient of the contacts: the published one, below the simulation's 1
    #[serde(default = "defaults::friction")]
    pub friction: f64,
    /// Edges of a contact's linearized friction cone: the published number
    #[serde(default = "defaults::edges")]
    pub edges: usize,
    /// Least min-weight metric of a grasp, times the number of edges of all contacts (1): the published one
    #[serde(default = "defaults::min_weight")]
    pub min_weight: f64,
    /// Farthest that a fingertip may be from the surface (m): the published tolerance
    #[serde(default = "defaults::max_gap_m")]
    pub max_gap_m: f64,
    /// Deepest that a link may be in the object or the table (m): the published tolerance
    #[serde(default = "defaults::max_depth_m")]
    pub max_depth_m: f64,
    /// Weight of a fingertip's distance from the surface (1): as in `refine`
    #[serde(default = "defaults::contact_weight")]
    pub contact_weight: f64,
    /// Weight of a link's depth in the object (1): as in `refine`
    #[serde(default = "defaults::object_weight")]
    pub object_weight: f64,
    /// Weight of a link's depth in the table (1): as in `refine`
    #[serde(default = "defaults::table_weight")]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): as in `refine`
    #[serde(default = "defaults::table_margin_m")]
    pub table_margin_m: f64,
    /// Weight of what the metric lacks to its greatest value (m), in the first round; a tenth of it in the last: a
    /// metric
    /// of 0 costs as much as a fingertip 1 cm off the surface
    #[serde(default = "defaults::min_weight_weight_m")]
    pub min_weight_weight_m: f64,
    /// Weight of a joint's distance from where it closed (m/rad): what nothing else has a say in stays
    #[serde(default = "defaults::joint_weight")]
    pub joint_weight: f64,
    /// Standard deviation along each axis of the point that a random palm points at, about the center of mass (m)
    #[serde(default = "defaults::palm_jitter_m")]
    pub palm_jitter_m: f64,
    /// The way to the grasp, and how the object lies
    #[serde(default)]
    pub approach: ApproachConfig,
}

impl ForceClosureConfig {
    /// Returns what is wrong with the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "each grasp is searched for";
        faults.within("per_object", self.per_object, 1..=MAX_GRASPS, why);
        let why = "a search that has not ended by then will not";
        faults.within(
            "max_iterations",
            self.max_iterations,
            0..=MAX_ITERATIONS,
            why,
        );
        let why = "each begins at another palm";
        faults.within("searches", self.searches, 1..=MAX_SEARCHES, why);
        let why = "no force is across a surface without friction, and no material has more";
        faults.above("friction", self.friction, 0.0, MAX_FRICTION, why);
        let why = "a cone has three edges at least, and the program to solve grows with them";
        faults.within("edges", self.edges, 3..=MAX_EDGES, why);
        let why = "it is a share of the greatest value";
        faults.within("min_weight", self.min_weight, 0.0..=1.0, why);
        let why = "no grasp is that far from a surface";
        for (key, length) in [
            ("max_gap_m", self.max_gap_m),
            ("max_depth_m", self.max_depth_m),
            ("table_margin_m", self.table_margin_m),
            ("palm_jitter_m", self.palm_jitter_m),
        ] {
            faults.within(key, length, 0.0..=MAX_TOLERANCE_M, why);
        }
        let why = "squares of larger values lose precision in a sum";
        for (key, weight) in [
            ("contact_weight", self.contact_weight),
            ("object_weight", self.object_weight),
            ("table_weight", self.table_weight),
            ("min_weight_weight_m", self.min_weight_weight_m),
            ("joint_weight", self.joint_weight),
        ] {
            faults.within(key, weight, 0.0..=MAX_WEIGHT, why);
        }
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
    pub(super) fn max_iterations() -> usize { 300 }
    pub(super) fn searches() -> usize { 20 }
    pub(super) fn friction() -> f64 { 0.7 }
    pub(super) fn edges() -> usize { 4 }
    pub(super) fn min_weight() -> f64 { 0.3 }
    pub(super) fn max_gap_m() -> f64 { 1e-3 }
    pub(super) fn max_depth_m() -> f64 { 1e-3 }
    pub(super) fn contact_weight() -> f64 { 3.0 }
    pub(super) fn object_weight() -> f64 { 3.0 }
    pub(super) fn table_weight() -> f64 { 3.0 }
    pub(super) fn table_margin_m() -> f64 { 0.002 }
    pub(super) fn min_weight_weight_m() -> f64 { 0.03 }
    pub(super) fn joint_weight() -> f64 { 0.002 }
    pub(super) fn palm_jitter_m() -> f64 { 0.01 }
}
