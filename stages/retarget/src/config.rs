//! Options of `kind = "retarget"`.

use std::path::PathBuf;

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest weight, length or time that makes sense: its squares still add up accurately.
const MAX_VALUE: f64 = 1e6;
/// Coarsest grid spacing of a distance field, in meters: coarser grids miss objects of a hand's size.
const COARSEST_M: f64 = 0.1;
/// Finest grid spacing of a distance field, in meters: finer, a mug has more than 2²⁶ grid points.
const FINEST_M: f64 = 1e-4;
/// Maximum number of iterations for one step.
const MAX_ITERATIONS: usize = 100_000;

/// Options of `kind = "retarget"`.
///
/// A weight multiplies its residual before it is squared; 0 switches a term off.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RetargetConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The hand's file: its side, its size, and which landmark each of its points follows.
    #[serde(skip_serializing)]
    pub hand_table: PathBuf,
    /// Whether the palm is placed so that the fingers reach their landmarks, or follows the
    /// person's palm alone: free, because with a fixed one a third fewer grasps succeed.
    #[serde(default)]
    pub wrist: Wrist,
    /// Loss of a point's distance to its landmark: squared, as in the paper.
    #[serde(default)]
    pub loss: Loss,
    /// Distance up to which `smooth_l1` is quadratic, per coordinate (m): that of dex-retargeting.
    #[serde(default = "defaults::smooth_l1_beta_m")]
    pub smooth_l1_beta_m: f64,
    /// Standard deviation of the smoothing of landmarks over time, 0 for none; the grasp stays
    /// unchanged (s). None: it has no significant effect.
    #[serde(default)]
    pub smoothing_s: f64,
    /// Weight of a point's change from the previously solved step, the paper's √λ (1).
    #[serde(default = "defaults::smoothness_weight")]
    pub smoothness_weight: f64,
    /// Weight of a joint's change from the previously solved step (m/rad): a radian counts as 2 cm,
    /// so that joints that no landmark constrains stay still.
    #[serde(default = "defaults::joint_smoothness_weight")]
    pub joint_smoothness_weight: f64,
    /// Weight of a link's depth inside the object, or inside its clearance (1): more than a
    /// landmark's; without it 8 of 100 fewer grasps succeed.
    #[serde(default = "defaults::object_weight")]
    pub object_weight: f64,
    /// Distance that links keep from the object before the hand closes (m): a motion that is
    /// executed unchanged does not knock the object over.
    #[serde(default = "defaults::clearance_m")]
    pub clearance_m: f64,
    /// Time before the grasp over which the clearance shrinks to zero (s): the time in which
    /// the fingers close.
    #[serde(default = "defaults::closing_time_s")]
    pub closing_time_s: f64,
    /// Weight of a link's depth below the table's margin (1): as the object's; without it every
    /// third hand is in the table.
    #[serde(default = "defaults::table_weight")]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): the contact margin of the simulation.
    #[serde(default = "defaults::table_margin_m")]
    pub table_margin_m: f64,
    /// Weight of a fingertip's distance from the surface where the person's tip is near it (1): as
    /// the object's; without it tips end 1.3 mm off the surface.
    #[serde(default = "defaults::contact_weight")]
    pub contact_weight: f64,
    /// Distance from the surface up to which a person's fingertip counts as touching (m): half a
    /// finger's thickness plus the error of its landmark.
    #[serde(default = "defaults::contact_distance_m")]
    pub contact_distance_m: f64,
    /// Factor on the position weight of a fingertip that is pulled to the surface (1): the surface
    /// has priority, the landmark selects the point on it.
    #[serde(default = "defaults::contact_position_factor")]
    pub contact_position_factor: f64,
    /// Grid spacing of an object's distance field (m): a fraction of a finger, at a few megabytes
    /// for each object.
    #[serde(default = "defaults::field_spacing_m")]
    pub field_spacing_m: f64,
    /// Most iterations for one step; the grasp gets more (1). A step starts from the solution of
    /// the one before it, and takes few.
    #[serde(default = "defaults::max_iterations")]
    pub max_iterations: usize,
    /// Root mean square keypoint error at the grasp above which a sequence is skipped (m): beyond
    /// it the hand does not reproduce the person's grasp.
    #[serde(default = "defaults::max_keypoint_error_m")]
    pub max_keypoint_error_m: f64,
}

/// Placement of the palm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wrist {
    /// With the joints, so that all points reach their landmarks as well as they can.
    #[default]
    Free,
    /// At the least distance of the palm's own points, at least three of them, from their landmarks.
    Fixed,
}

/// Loss of a point's distance to its landmark.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// Squared, as in the paper.
    #[default]
    Squared,
    /// Quadratic up to `smooth_l1_beta_m` per coordinate, and linear beyond: far landmarks count
    /// less.
    SmoothL1,
}

impl RetargetConfig {
    /// Returns what is wrong with the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        for (key, number) in [
            ("smoothing_s", self.smoothing_s),
            ("smoothness_weight", self.smoothness_weight),
            ("joint_smoothness_weight", self.joint_smoothness_weight),
            ("object_weight", self.object_weight),
            ("clearance_m", self.clearance_m),
            ("closing_time_s", self.closing_time_s),
            ("table_weight", self.table_weight),
            ("table_margin_m", self.table_margin_m),
            ("contact_weight", self.contact_weight),
            ("contact_distance_m", self.contact_distance_m),
            ("contact_position_factor", self.contact_position_factor),
            ("max_keypoint_error_m", self.max_keypoint_error_m),
        ] {
            let why = "squares of larger values lose precision in a sum";
            faults.within(key, number, 0.0..=MAX_VALUE, why);
        }
        let why = "it is the length up to which the loss is quadratic";
        faults.above(
            "smooth_l1_beta_m",
            self.smooth_l1_beta_m,
            0.0,
            MAX_VALUE,
            why,
        );
        let why = "a coarser grid misses objects of a hand's size, and a finer one of a mug has \
                   more than 2²⁶ points";
        let spacing_m = self.field_spacing_m;
        faults.within("field_spacing_m", spacing_m, FINEST_M..=COARSEST_M, why);
        let why = "0 solves nothing, and a solver that needs more does not converge";
        let iterations = self.max_iterations;
        faults.within("max_iterations", iterations, 1..=MAX_ITERATIONS, why);
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn smooth_l1_beta_m() -> f64 { 0.02 }
    pub(super) fn smoothness_weight() -> f64 { 0.2 }
    pub(super) fn joint_smoothness_weight() -> f64 { 0.02 }
    pub(super) fn object_weight() -> f64 { 3.0 }
    pub(super) fn clearance_m() -> f64 { 0.008 }
    pub(super) fn closing_time_s() -> f64 { 0.3 }
    pub(super) fn table_weight() -> f64 { 3.0 }
    pub(super) fn table_margin_m() -> f64 { 0.002 }
    pub(super) fn contact_weight() -> f64 { 3.0 }
    pub(super) fn contact_distance_m() -> f64 { 0.015 }
    pub(super) fn contact_position_factor() -> f64 { 0.5 }
    pub(super) fn field_spacing_m() -> f64 { 0.0025 }
    pub(super) fn max_iterations() -> usize { 30 }
    pub(super) fn max_keypoint_error_m() -> f64 { 0.05 }
}
