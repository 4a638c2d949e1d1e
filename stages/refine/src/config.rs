//! Options of `kind = "refine"`.

use std::{f64::consts::FRAC_PI_2, path::PathBuf};

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest weight, length or share that makes sense: its squares still add up accurately.
const MAX_VALUE: f64 = 1e6;
/// Smallest force of the thumb, in newtons: a thousandth of what small drives give.
const MIN_FORCE_N: f64 = 1e-3;
/// Most samples of one motion.
const MAX_DRAWS: usize = 10_000;
/// Maximum number of iterations for one step.
const MAX_ITERATIONS: usize = 100_000;

/// Options of `kind = "refine"`.
///
/// A weight multiplies its residual before it is squared; 0 switches a term off.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RefineConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The hand's file: which points of the hand stand for its posture, and which are fingertips.
    #[serde(skip_serializing)]
    pub hand_table: PathBuf,
    /// Of so many consecutive candidates with the same resting pose, the one with the smallest residual is kept,
    /// without physics (1); a last, incomplete group counts as one.
    #[serde(default = "defaults::draws")]
    pub draws: usize,
    /// Weight of a point's distance from its sampled place (1): far below the object's, so that the sample gives way.
    #[serde(default = "defaults::position_weight")]
    pub position_weight: f64,
    /// Weight of a joint's distance from its sampled position (m/rad): a radian counts as 5 mm.
    #[serde(default = "defaults::joint_weight")]
    pub joint_weight: f64,
    /// Weight of the change of a point's displacement from one step to the next (1): neighboring
    /// steps move together.
    #[serde(default = "defaults::smoothness_weight")]
    pub smoothness_weight: f64,
    /// Weight of the change of a joint's displacement from one step to the next (m/rad): a radian counts as 2 cm,
    /// as in retargeting.
    #[serde(default = "defaults::joint_smoothness_weight")]
    pub joint_smoothness_weight: f64,
    /// Weight of a link's depth inside the object, or inside its clearance (1): thirty times a point's.
    #[serde(default = "defaults::object_weight")]
    pub object_weight: f64,
    /// Distance that links keep from the object before the hand closes (m): that of retargeting.
    #[serde(default = "defaults::clearance_m")]
    pub clearance_m: f64,
    /// Share of the motion, at its end, over which the clearance shrinks to nothing (1): that in which
    /// the fingers close.
    #[serde(default = "defaults::closing_share")]
    pub closing_share: f64,
    /// Weight of a link's depth below the table's margin (1): as the object's.
    #[serde(default = "defaults::table_weight")]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): the contact margin of the simulation.
    #[serde(default = "defaults::table_margin_m")]
    pub table_margin_m: f64,
    /// Weight of a fingertip's distance from the surface at the grasp (1): as the object's; 0 switches off the
    /// balance and the squeeze too.
    #[serde(default = "defaults::contact_weight")]
    pub contact_weight: f64,
    /// Distance from the surface up to which a sampled fingertip is one that should touch (m): about the error of a
    /// learned fingertip; it fades out at 1.5 times that.
    #[serde(default = "defaults::contact_distance_m")]
    pub contact_distance_m: f64,
    /// Factor on the position weight of a fingertip that should touch (1): the surface has priority.
    #[serde(default = "defaults::contact_position_factor")]
    pub contact_position_factor: f64,
    /// Weight of the residual wrench of the fingertips, as a share of the thumb's force (m): 0.15 of the force
    /// counts like a tip 5 mm off the surface.
    #[serde(default = "defaults::balance_weight")]
    pub balance_weight: f64,
    /// Friction coefficient of the force balance (1): below the true one, as a margin for fingertip errors.
    #[serde(default = "defaults::balance_friction")]
    pub balance_friction: f64,
    /// Force of the thumb in the force balance (N): the object's weight is relative to it; 0.7 Nm at 10 cm.
    #[serde(default = "defaults::thumb_force_n")]
    pub thumb_force_n: f64,
    /// Rotation of restarts about each axis of the palm, both ways, and then by twice as much, where the residual of
    /// the grasp stays large (rad); 0 for no restarts. Smaller ones find the same grasp again.
    #[serde(default = "defaults::restart_angle_rad")]
    pub restart_angle_rad: f64,
    /// Commanded depth of a fingertip beyond its contact, for a force equal to the thumb's (m): the squeeze, at the
    /// end of the motion; with less the drives press too little, with more fingers slide.
    #[serde(default = "defaults::squeeze_m")]
    pub squeeze_m: f64,
    /// Maximum number of iterations for one step, which starts near its solution; the grasp gets three times as
    /// many (1).
    #[serde(default = "defaults::max_iterations")]
    pub max_iterations: usize,
}

impl RefineConfig {
    /// Returns what is wrong with the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        for (key, number) in [
            ("position_weight", self.position_weight),
            ("joint_weight", self.joint_weight),
            ("smoothness_weight", self.smoothness_weight),
            ("joint_smoothness_weight", self.joint_smoothness_weight),
            ("object_weight", self.object_weight),
            ("clearance_m", self.clearance_m),
            ("table_weight", self.table_weight),
            ("table_margin_m", self.table_margin_m),
            ("contact_weight", self.contact_weight),
            ("contact_distance_m", self.contact_distance_m),
            ("contact_position_factor", self.contact_position_factor),
            ("balance_weight", self.balance_weight),
            ("balance_friction", self.balance_friction),
            ("squeeze_m", self.squeeze_m),
        ] {
            let why = "squares of larger values lose precision in a sum";
            faults.within(key, number, 0.0..=MAX_VALUE, why);
        }
        let force_n = self.thumb_force_n;
        let why = "weights are relative to it, and their squares lose precision beyond";
        faults.within("thumb_force_n", force_n, MIN_FORCE_N..=MAX_VALUE, why);
        let why = "larger rotations repeat smaller ones";
        let angle_rad = self.restart_angle_rad;
        faults.within("restart_angle_rad", angle_rad, 0.0..=FRAC_PI_2, why);
        let why = "each motion is refined, and one of so many is kept";
        faults.within("draws", self.draws, 1..=MAX_DRAWS, why);
        let why = "it is a share of the motion";
        faults.within("closing_share", self.closing_share, 0.0..=1.0, why);
        let why = "nothing is searched with 0, and a search that has not ended by then will not";
        let iterations = self.max_iterations;
        faults.within("max_iterations", iterations, 1..=MAX_ITERATIONS, why);
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn draws() -> usize { 1 }
    pub(super) fn position_weight() -> f64 { 0.1 }
    pub(super) fn joint_weight() -> f64 { 0.005 }
    pub(super) fn smoothness_weight() -> f64 { 1.0 }
    pub(super) fn joint_smoothness_weight() -> f64 { 0.02 }
    pub(super) fn object_weight() -> f64 { 3.0 }
    pub(super) fn clearance_m() -> f64 { 0.008 }
    pub(super) fn closing_share() -> f64 { 0.25 }
    pub(super) fn table_weight() -> f64 { 3.0 }
    pub(super) fn table_margin_m() -> f64 { 0.002 }
    pub(super) fn contact_weight() -> f64 { 3.0 }
    pub(super) fn contact_distance_m() -> f64 { 0.025 }
    pub(super) fn contact_position_factor() -> f64 { 0.5 }
    pub(super) fn balance_weight() -> f64 { 0.1 }
    pub(super) fn balance_friction() -> f64 { 0.2 }
    pub(super) fn thumb_force_n() -> f64 { 7.0 }
    pub(super) fn restart_angle_rad() -> f64 { 0.5 }
    pub(super) fn squeeze_m() -> f64 { 0.008 }
    pub(super) fn max_iterations() -> usize { 30 }
}
