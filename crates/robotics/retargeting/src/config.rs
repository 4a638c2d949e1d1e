//! Options of retargeting.

use options::{above, options};
use posture::Hand;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::RetargetingError;

/// Largest weight, length or time that makes sense: its squares still add up accurately.
const MAX_VALUE: f64 = 1e6;
/// Reason for the bound [`MAX_VALUE`].
const SQUARES: &str = "squares of larger values lose precision in a sum";
/// Maximum number of iterations for one step.
const MAX_ITERATIONS: usize = 100_000;

/// Options of the objective and its search.
///
/// A weight multiplies its residual before it is squared; 0 switches a term off.
#[options]
pub struct RetargetingConfig {
    /// Whether the palm is placed so that the fingers reach their landmarks, or follows the
    /// person's palm alone: free, because with a fixed one a third fewer grasps succeed.
    #[option(default)]
    pub wrist: Wrist,
    /// Loss of a point's distance to its landmark: squared, as in the paper.
    #[option(default)]
    pub loss: Loss,
    /// Distance up to which `smooth_l1` is quadratic, per coordinate (m): that of dex-retargeting.
    #[option(
        default = 0.02, range = above(0.0, MAX_VALUE),
        why = "it is the length up to which the loss is quadratic"
    )]
    pub smooth_l1_beta_m: f64,
    /// Standard deviation of the smoothing of landmarks over time, 0 for none; the grasp stays
    /// unchanged (s). None: it has no significant effect.
    #[option(default, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub smoothing_s: f64,
    /// Weight of a point's change from the previously solved step, the paper's √λ (1).
    #[option(default = 0.2, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub smoothness_weight: f64,
    /// Weight of a joint's change from the previously solved step (m/rad): a radian counts as 2 cm,
    /// so that joints that no landmark constrains stay still.
    #[option(default = 0.02, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub joint_smoothness_weight: f64,
    /// Weight of a link's depth inside the object, or inside its clearance (1): more than a
    /// landmark's; without it 8 of 100 fewer grasps succeed.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub object_weight: f64,
    /// Distance that links keep from the object before the hand closes (m): a motion that is
    /// executed unchanged does not knock the object over.
    #[option(default = 0.008, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub clearance_m: f64,
    /// Time before the grasp over which the clearance shrinks to zero (s): the time in which
    /// the fingers close.
    #[option(default = 0.3, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub closing_time_s: f64,
    /// Weight of a link's depth below the table's margin (1): as the object's; without it every
    /// third hand is in the table.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub table_weight: f64,
    /// Distance that links keep from the table (m): the contact margin of the simulation.
    #[option(default = 0.002, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub table_margin_m: f64,
    /// Weight of a fingertip's distance from the surface where the person's tip is near it (1): as
    /// the object's; without it tips end 1.3 mm off the surface.
    #[option(default = 3.0, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_weight: f64,
    /// Distance from the surface up to which a person's fingertip counts as touching (m): half a
    /// finger's thickness plus the error of its landmark.
    #[option(default = 0.015, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_distance_m: f64,
    /// Factor on the position weight of a fingertip that is pulled to the surface (1): the surface
    /// has priority, the landmark selects the point on it.
    #[option(default = 0.5, range = 0.0..=MAX_VALUE, why = SQUARES)]
    pub contact_position_factor: f64,
    /// Most iterations for one step; the grasp gets more (1). A step starts from the solution of
    /// the one before it, and takes few.
    #[option(
        default = 30, range = 1..=MAX_ITERATIONS,
        why = "0 solves nothing, and a solver that needs more does not converge"
    )]
    pub max_iterations: usize,
}

impl RetargetingConfig {
    /// Checks that a wrist that is to be fixed can be placed.
    ///
    /// # Errors
    ///
    /// Fails if fewer than three points of the hand are on its palm, or all of them on one line.
    pub fn check_wrist(&self, hand: &Hand) -> Result<(), RetargetingError> {
        let found = hand.palm_points.len();
        match self.wrist {
            Wrist::Fixed if found < 3 => Err(RetargetingError::TooFewPalmPoints { found }),
            Wrist::Fixed if hand.palm_points_are_collinear() => {
                Err(RetargetingError::PalmPointsInLine { found })
            }
            Wrist::Fixed | Wrist::Free => Ok(()),
        }
    }
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
