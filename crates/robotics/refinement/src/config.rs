//! Options of refinement.

use std::f64::consts::FRAC_PI_2;

use options::options;

/// Largest weight, length or share that makes sense: its squares still add up accurately.
const MAX_VALUE: f64 = 1e6;
/// Reason for the bound [`MAX_VALUE`].
const SQUARES: &str = "squares of larger values lose precision in a sum";
/// Smallest force of the thumb, in newtons: a thousandth of what small drives give.
const MIN_FORCE_N: f64 = 1e-3;
/// Maximum number of iterations for one step.
const MAX_ITERATIONS: usize = 100_000;

/// Options of the objective and its search.
///
/// A weight multiplies its residual before it is squared; 0 switches a term off.
#[options]
pub struct RefinementConfig {
    /// Weight of a point's distance from its sampled place (1): far below the object's, so that the sample gives way.
    #[option(default = 0.1, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub position_weight: f64,
    /// Weight of a joint's distance from its sampled position (m/rad): a radian counts as 5 mm.
    #[option(default = 0.005, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub joint_weight: f64,
    /// Weight of the change of a point's displacement from one step to the next (1): neighboring
    /// steps move together.
    #[option(default = 1.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub smoothness_weight: f64,
    /// Weight of the change of a joint's displacement from one step to the next (m/rad): a radian counts as 2 cm,
    /// as in retargeting.
    #[option(default = 0.02, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub joint_smoothness_weight: f64,
    /// Weight of a link's depth inside the object, or inside its clearance (1): thirty times a point's.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub object_weight: f64,
    /// Distance that links keep from the object before the hand closes (m): that of retargeting.
    #[option(default = 0.008, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub clearance_m: f64,
    /// Share of the motion, at its end, over which the clearance shrinks to nothing (1): that in which
    /// the fingers close.
    #[option(default = 0.25, range = 0.0..=1.0, why = "it is a share of the motion")]
    pub closing_share: f64,
    /// Weight of a link's depth below the table's margin (1): as the object's.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): the contact margin of the simulation.
    #[option(default = 0.002, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub table_margin_m: f64,
    /// Weight of what a finger lacks to its margin from another finger, or from the palm (0); 1 is for screens in which
    /// they touch (`full_contact`): there it takes a sixth more time, and 92 instead of 56 % of the sample's motions
    /// succeed.
    #[option(default, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub self_collision_weight: f64,
    /// Distance that fingers keep from each other and from the palm (m): the table's.
    #[option(default = 0.002, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub self_collision_margin_m: f64,
    /// Weight of a fingertip's distance from the surface at the grasp (1): as the object's; 0 switches off the
    /// balance and the squeeze too.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_weight: f64,
    /// Distance from the surface up to which a sampled fingertip is one that should touch (m): about the error of a
    /// learned fingertip; it fades out at 1.5 times that.
    #[option(default = 0.025, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_distance_m: f64,
    /// Factor on the position weight of a fingertip that should touch (1): the surface has priority.
    #[option(default = 0.5, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_position_factor: f64,
    /// Weight of the residual wrench of the fingertips, as a share of the thumb's force (m): 0.15 of the force
    /// counts like a tip 5 mm off the surface.
    #[option(default = 0.1, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub balance_weight: f64,
    /// Friction coefficient of the force balance (1): below the true one, as a margin for fingertip errors.
    #[option(default = 0.2, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub balance_friction: f64,
    /// Force of the thumb in the force balance (N): the object's weight is relative to it; 0.7 Nm at 10 cm.
    #[option(
        default = 7.0, range = MIN_FORCE_N..=MAX_VALUE,
        why = "weights are relative to it, and their squares lose precision beyond"
    )]
    pub thumb_force_n: f64,
    /// Rotation of restarts about each axis of the palm, both ways, and then by twice as much, where the residual of
    /// the grasp stays large (rad); 0 for no restarts. Smaller ones find the same grasp again.
    #[option(default = 0.5, range = 0.0..=FRAC_PI_2, why = "larger rotations repeat smaller ones")]
    pub restart_angle_rad: f64,
    /// Commanded depth of a fingertip beyond its contact, for a force equal to the thumb's (m): the squeeze, at the
    /// end of the motion; with less the drives press too little, with more fingers slide.
    #[option(default = 0.008, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub squeeze_m: f64,
    /// Maximum number of iterations for one step, which starts near its solution; the grasp gets three times as
    /// many (1).
    #[option(
        default = 30, range = 1..=MAX_ITERATIONS,
        why = "nothing is searched with 0, and a search that has not ended by then will not"
    )]
    pub max_iterations: usize,
}
