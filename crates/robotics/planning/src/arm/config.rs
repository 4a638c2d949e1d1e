//! Options of the arm that carries the hand.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::SettingFault;
use spatial::{Base, Pose, Table};

/// Maximum number of yaw angles of the object that may be tried.
const MAX_YAWS: usize = 360;

/// The arm that carries the hand: its place and the limits of its joints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct ArmConfig {
    /// URDF of the arm with the hand on it; its root link is the arm's base.
    #[serde(skip_serializing)]
    pub robot: PathBuf,
    /// The link of `robot` that is the hand's palm.
    pub palm: String,
    /// Pose of the arm's base in the table's frame: `x, y, z` (m) and the quaternion `x, y, z, w`.
    /// The table's top is at z = 0, and z is up.
    pub table_from_base: [f64; 7],
    /// Position of the object on the table (m): `x, y` of its origin in the table's frame.
    pub object_m: [f64; 2],
    /// Number of yaw angles of the object that are tried, evenly spread over a turn; with 1 it
    /// keeps that of the screen. Every 15°: one of them is nearly always in reach.
    #[serde(default = "defaults::turns")]
    pub turns: usize,
    /// Largest speed of the arm's joints as a fraction of the URDF's: all of it, because a motion
    /// is slowed down only where necessary.
    #[serde(default = "defaults::velocity_scale")]
    pub velocity_scale: f64,
    /// Largest acceleration of the arm's joints (rad/s²; m/s² if prismatic): below the 20 rad/s² of
    /// an xArm's.
    #[serde(default = "defaults::acceleration_rad_per_s2")]
    pub acceleration_rad_per_s2: f64,
    /// Least clearance of the arm's links from the table, from each other and from the hand (m), by
    /// the URDF's collision shapes; `protocol` sets the tolerances of the hand alone. Half a centimeter:
    /// a typical calibration error.
    #[serde(default = "defaults::clearance_m")]
    pub clearance_m: f64,
    /// Least singular value of the arm's Jacobian, in mixed meters and radians: below it the arm is
    /// too near a singularity, where joints turn fast while the hand moves slowly. At 0.02 a joint
    /// turns at 3.14 rad/s for 6 cm/s of the hand.
    #[serde(default = "defaults::min_singular_value")]
    pub min_singular_value: f64,
}

impl ArmConfig {
    /// Returns the pose of the arm's base in the table's frame.
    ///
    /// # Errors
    ///
    /// Fails if the option's numbers are not a pose.
    pub fn table_from_base(&self) -> Result<Pose<Table, Base>, SettingFault> {
        Pose::from_array(self.table_from_base).map_err(|err| {
            let problem = err.to_string();
            SettingFault::new("arm.table_from_base", problem)
        })
    }

    /// Checks the options beyond their types.
    ///
    /// # Errors
    ///
    /// Fails with the first invalid option.
    pub fn check(&self) -> Result<(), SettingFault> {
        let wrong = |key: &'static str, problem: String| SettingFault::new(key, problem);
        let positive = [
            ("arm.velocity_scale", self.velocity_scale),
            ("arm.acceleration_rad_per_s2", self.acceleration_rad_per_s2),
            ("arm.min_singular_value", self.min_singular_value),
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
        if self.turns == 0 || self.turns > MAX_YAWS {
            let turns = self.turns;
            let problem = format!(
                "is {turns}, and must be from 1 to {MAX_YAWS}: an object turned by less than a degree \
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
    pub(super) fn min_singular_value() -> f64 { 0.02 }
}
