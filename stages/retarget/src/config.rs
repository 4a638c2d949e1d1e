//! Options of `kind = "retarget"`.

use std::path::PathBuf;

use schemars::JsonSchema;
use schemas::demonstrations::{KEYPOINTS, Side};
use serde::{Deserialize, Serialize};

use crate::RetargetError;

/// Options of `kind = "retarget"`.
///
/// A weight multiplies its residual before it is squared; 0 switches a term off.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RetargetConfig {
    /// URDF of the robot hand; its root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// Side of the robot hand; demonstrations of the other hand are skipped.
    pub side: Side,
    /// Which landmark of the human hand each point of the robot follows.
    pub correspondences: Vec<Correspondence>,
    /// Size of the robot hand relative to the person's: landmarks are scaled by it about the wrist (1).
    pub hand_scale: f64,
    /// Weight of a point's distance to where it was in the step solved before, the paper's √λ (1).
    pub smoothness_weight: f64,
    /// Weight of a joint's change against the step solved before (m/rad).
    pub joint_smoothness_weight: f64,
    /// Weight of a link's depth inside the object, or inside its clearance (1).
    pub object_weight: f64,
    /// Distance that links keep from the object before the hand closes (m).
    pub clearance_m: f64,
    /// How long before the grasp the clearance begins to shrink to nothing (s).
    pub closing_time_s: f64,
    /// Weight of a link's depth below the table's margin (1).
    pub table_weight: f64,
    /// Distance that links keep from the table (m).
    pub table_margin_m: f64,
    /// Weight of a finger tip's distance from the surface where the person's tip is near it (1).
    pub contact_weight: f64,
    /// Distance from the surface up to which a person's finger tip counts as touching (m).
    pub contact_distance_m: f64,
    /// Factor on the position weight of a finger tip that is drawn to the surface (1).
    pub contact_position_factor: f64,
    /// Largest number of iterations for one step; the grasp gets more (1).
    pub max_iterations: usize,
    /// Mean keypoint error at the grasp above which a sequence is left out (m).
    pub max_keypoint_error_m: f64,
}

/// A point of the robot and the landmark that it follows.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Correspondence {
    /// Landmark, 0 to 20: the wrist, then thumb, index, middle, ring and little finger from base to tip.
    pub keypoint: usize,
    /// Link of the robot.
    pub link: String,
    /// The point in the link's frame, xyz (m).
    #[serde(default)]
    pub offset_m: [f64; 3],
    /// Weight of the distance between the point and the landmark (1).
    pub weight: f64,
    /// Marks a finger tip and gives the radius of the ball about the point (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tip_radius_m: Option<f64>,
}

impl RetargetConfig {
    /// Checks what types cannot say.
    ///
    /// # Errors
    ///
    /// Fails at the first value that makes no sense.
    pub(crate) fn check(&self) -> Result<(), RetargetError> {
        let bad = |key: &str, problem: String| {
            Err(RetargetError::BadOption {
                key: key.to_owned(),
                problem,
            })
        };
        let numbers = [
            ("hand_scale", self.hand_scale),
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
        ];
        for (key, number) in numbers {
            if !number.is_finite() || number < 0.0 {
                return bad(key, format!("{number} is not a number of at least 0"));
            }
        }
        if self.hand_scale == 0.0 {
            return bad("hand_scale", "0 leaves no hand".to_owned());
        }
        if self.correspondences.len() < 3 {
            return bad(
                "correspondences",
                format!(
                    "{} points cannot fix a hand, expected at least 3",
                    self.correspondences.len()
                ),
            );
        }
        for (idx, c) in self.correspondences.iter().enumerate() {
            let key = format!("correspondences[{idx}]");
            if c.keypoint >= KEYPOINTS {
                return bad(
                    &key,
                    format!(
                        "`keypoint = {}`, expected 0 to {}",
                        c.keypoint,
                        KEYPOINTS - 1
                    ),
                );
            }
            if !c.weight.is_finite() || c.weight < 0.0 || !c.offset_m.iter().all(|x| x.is_finite())
            {
                return bad(
                    &key,
                    "weight and offset must be finite, the weight at least 0".to_owned(),
                );
            }
            if c.tip_radius_m
                .is_some_and(|radius| !radius.is_finite() || radius < 0.0)
            {
                return bad(&key, "`tip_radius_m` must be at least 0".to_owned());
            }
        }
        Ok(())
    }
}
