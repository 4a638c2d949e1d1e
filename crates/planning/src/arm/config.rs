//! Options of the arm that carries the hand.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spatial::Pose;

use crate::OptionError;

/// Most turns of the object that are tried.
const MOST_TURNS: usize = 360;

/// The arm that carries the hand: where it stands, and how its joints may move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct ArmConfig {
    /// URDF of the arm with the hand on it; its root link is the arm's foot.
    #[serde(skip_serializing)]
    pub robot: PathBuf,
    /// The link of `robot` that is the hand's palm.
    pub palm: String,
    /// Pose of the arm's foot in the table's frame: `x, y, z` (m) and the quaternion `x, y, z, w`. The
    /// table's top is at z = 0, and z is up.
    pub table_from_base: [f64; 7],
    /// Where on the table the object stands (m): `x, y` of its origin in the table's frame.
    pub object_m: [f64; 2],
    /// How many directions of the object on the table are tried, evenly spread over a turn; with 1
    /// it stands as it was screened. Every 15°: one of them is nearly always in reach.
    #[serde(default = "defaults::turns")]
    pub turns: usize,
    /// Largest speed of the arm's joints as a share of that of the URDF: all of it, for a motion is
    /// slowed down only where it must be.
    #[serde(default = "defaults::velocity_scale")]
    pub velocity_scale: f64,
    /// Largest acceleration of the arm's joints (rad/s²; m/s² if prismatic): below the 20 rad/s² of
    /// an xArm's.
    #[serde(default = "defaults::acceleration_rad_per_s2")]
    pub acceleration_rad_per_s2: f64,
    /// How far the arm's links keep from the table, from each other and from the hand (m), at
    /// least. As far as the URDF's collision shapes tell; the hand alone is judged by `grasp`. Half
    /// a centimeter: what a calibration is off.
    #[serde(default = "defaults::clearance_m")]
    pub clearance_m: f64,
    /// Least singular value of the arm's Jacobian, meters and radians taken as they are: where it
    /// is less, the arm is too near a singularity, in which joints turn fast while the hand moves
    /// slowly. At 0.02 a joint turns at 3.14 rad/s for 6 cm/s of the hand.
    #[serde(default = "defaults::least_singular_value")]
    pub least_singular_value: f64,
}

/// The frame of the arm's foot, the URDF's root link.
#[derive(Debug, Clone, Copy)]
pub enum Base {}

impl ArmConfig {
    /// Returns the pose of the arm's foot in the table's frame.
    ///
    /// # Errors
    ///
    /// Fails if the option's numbers are no pose.
    pub fn table_from_base(&self) -> Result<Pose<spatial::Table, Base>, OptionError> {
        Pose::from_array(self.table_from_base).map_err(|err| {
            let problem = err.to_string();
            OptionError::new("arm.table_from_base", problem)
        })
    }

    /// Checks what types cannot say.
    ///
    /// # Errors
    ///
    /// Fails with the first option that cannot be used.
    pub fn check(&self) -> Result<(), OptionError> {
        let wrong = |key: &'static str, problem: String| OptionError::new(key, problem);
        let positive = [
            ("arm.velocity_scale", self.velocity_scale),
            ("arm.acceleration_rad_per_s2", self.acceleration_rad_per_s2),
            ("arm.least_singular_value", self.least_singular_value),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(wrong(key, format!("{value} is not more than 0")));
            }
        }
        if self.velocity_scale > 1.0 {
            let problem = format!("{} is more than 1", self.velocity_scale);
            return Err(wrong("arm.velocity_scale", problem));
        }
        if !(self.clearance_m.is_finite() && self.clearance_m >= 0.0) {
            let problem = format!("{} m is not 0 or more", self.clearance_m);
            return Err(wrong("arm.clearance_m", problem));
        }
        if !self.object_m.iter().all(|number| number.is_finite()) {
            return Err(wrong("arm.object_m", format!("{:?}", self.object_m)));
        }
        if self.turns == 0 || self.turns > MOST_TURNS {
            let turns = self.turns;
            let problem = format!(
                "is {turns}, and must be from 1 to {MOST_TURNS}: an object turned by less than a degree \
                 stands as it did"
            );
            return Err(wrong("arm.turns", problem));
        }
        self.table_from_base().map(|_| ())
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn turns() -> usize { 24 }
    pub(super) fn velocity_scale() -> f64 { 1.0 }
    pub(super) fn acceleration_rad_per_s2() -> f64 { 15.0 }
    pub(super) fn clearance_m() -> f64 { 0.005 }
    pub(super) fn least_singular_value() -> f64 { 0.02 }
}
