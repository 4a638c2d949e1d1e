//! Options of `kind = "force_closure"`.

use std::path::PathBuf;

use approach::ApproachConfig;
use options::{OptionFaults, above, options};

/// Most grasps of one object.
const MAX_GRASPS: usize = 100_000;
/// Most iterations of one search.
const MAX_ITERATIONS: usize = 100_000;
/// Most searches for one grasp.
const MAX_SEARCHES: usize = 10_000;
/// Largest weight: its squares still add up accurately.
const MAX_WEIGHT: f64 = 1e6;
/// Reason for the bound [`MAX_WEIGHT`].
const SQUARES: &str = "squares of larger values lose precision in a sum";
/// Greatest friction coefficient.
const MAX_FRICTION: f64 = 10.0;
/// Most edges of a linearized cone: the program to solve grows with them.
const MAX_EDGES: usize = 32;
/// Greatest length that a tolerance makes sense of, in meters.
const MAX_TOLERANCE_M: f64 = 0.1;

/// Options of `kind = "force_closure"`.
///
/// A weight multiplies its residual before it is squared.
#[options(also = Self::combined_faults)]
pub struct ForceClosureConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm
    #[option(path)]
    pub hand: PathBuf,
    /// The hand's file: which points of the hand are fingertips, and their radii
    #[option(path)]
    pub hand_table: PathBuf,
    /// Names of the joints that bend the fingers, each with growing positions
    pub flexion_joints: Vec<String>,
    /// Objects to grasp, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Grasps per object: as many as the motions of `sample`
    #[option(default = 64, range = 1..=MAX_GRASPS, why = "each grasp is searched for")]
    pub per_object: usize,
    /// Maximum number of iterations of one search, each an evaluation of the metric and its gradient, over all its
    /// rounds; 0: random palms whose fingers close; published: 1000, of a solver that takes shorter steps
    #[option(
        default = 300, range = 0..=MAX_ITERATIONS,
        why = "a search that has not ended by then will not"
    )]
    pub max_iterations: usize,
    /// Most searches for one grasp until one ends as it should; if none does, the one that comes nearest is kept;
    /// published: as many as it takes, within 60 s
    #[option(default = 20, range = 1..=MAX_SEARCHES, why = "each begins at another palm")]
    pub searches: usize,
    /// Friction coefficient of the contacts: the published one, below the simulation's 1
    #[option(
        default = 0.7, range = above(0.0, MAX_FRICTION),
        why = "no force is across a surface without friction, and no material has more"
    )]
    pub friction: f64,
    /// Edges of a contact's linearized friction cone: the published number
    #[option(
        default = 4, range = 3..=MAX_EDGES,
        why = "a cone has three edges at least, and the program to solve grows with them"
    )]
    pub edges: usize,
    /// Least min-weight metric of a grasp, times the number of edges of all contacts (1): the published one
    #[option(default = 0.3, range = 0.0..=1.0, why = "it is a share of the greatest value")]
    pub min_weight: f64,
    /// Farthest that a fingertip may be from the surface (m): the published tolerance
    #[option(
        default = 1e-3, range = 0.0..=MAX_TOLERANCE_M,
        why = "no grasp is that far from a surface"
    )]
    pub max_gap_m: f64,
    /// Deepest that a link may be in the object or the table (m): the published tolerance
    #[option(
        default = 1e-3, range = 0.0..=MAX_TOLERANCE_M,
        why = "no grasp is that far from a surface"
    )]
    pub max_depth_m: f64,
    /// Weight of a fingertip's distance from the surface (1): as in `refine`
    #[option(default = 3.0, range = 0.0..=MAX_WEIGHT, why = SQUARES)]
    pub contact_weight: f64,
    /// Weight of a link's depth in the object (1): as in `refine`
    #[option(default = 3.0, range = 0.0..=MAX_WEIGHT, why = SQUARES)]
    pub object_weight: f64,
    /// Weight of a link's depth in the table (1): as in `refine`
    #[option(default = 3.0, range = 0.0..=MAX_WEIGHT, why = SQUARES)]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): as in `refine`
    #[option(
        default = 0.002, range = 0.0..=MAX_TOLERANCE_M,
        why = "no grasp is that far from a surface"
    )]
    pub table_margin_m: f64,
    /// Weight of what the metric lacks to its greatest value (m), in the first round; a tenth of it in the last: a
    /// metric
    /// of 0 costs as much as a fingertip 1 cm off the surface
    #[option(default = 0.03, range = 0.0..=MAX_WEIGHT, why = SQUARES)]
    pub min_weight_weight_m: f64,
    /// Weight of a joint's distance from where it closed (m/rad): what nothing else has a say in stays
    #[option(default = 0.002, range = 0.0..=MAX_WEIGHT, why = SQUARES)]
    pub joint_weight: f64,
    /// Standard deviation along each axis of the point that a random palm points at, about the center of mass (m)
    #[option(
        default = 0.01, range = 0.0..=MAX_TOLERANCE_M,
        why = "no grasp is that far from a surface"
    )]
    pub palm_jitter_m: f64,
    /// The way to the grasp, and how the object lies
    #[option(default, table)]
    pub approach: ApproachConfig,
}

impl ForceClosureConfig {
    fn combined_faults(&self, faults: &mut OptionFaults) {
        if self.flexion_joints.is_empty() {
            faults.note("flexion_joints", "is empty, and fingers close with them");
        }
    }
}
