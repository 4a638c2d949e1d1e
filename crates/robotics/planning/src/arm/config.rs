//! Options of the arm that carries the hand.

use std::path::PathBuf;

use options::{OptionFault, OptionFaults, above, options};
use spatial::{Base, Pose, Table};

/// Maximum number of yaw angles of the object that may be tried.
const MAX_YAWS: usize = 360;
/// Greatest acceleration, singular value or length of an arm.
const MAX_NUMBER: f64 = 1e6;

/// The arm that carries the hand: its place and the limits of its joints.
#[options(also = Self::pose_faults)]
#[derive(PartialEq)]
#[schemars(inline)]
pub struct ArmConfig {
    /// URDF of the arm with the hand on it; its root link is the arm's base.
    #[option(path)]
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
    #[option(
        default = 24, range = 1..=MAX_YAWS,
        why = "an object turned by less than a degree stands as it did"
    )]
    pub turns: usize,
    /// Largest speed of the arm's joints as a fraction of the URDF's: all of it, because a motion
    /// is slowed down only where necessary.
    #[option(
        default = 1.0, range = above(0.0, 1.0),
        why = "a motion takes time, and no joint is faster than its limit"
    )]
    pub velocity_scale: f64,
    /// Largest acceleration of the arm's joints (rad/s²; m/s² if prismatic): below the 20 rad/s² of
    /// an xArm's.
    #[option(
        default = 15.0, range = above(0.0, MAX_NUMBER),
        why = "a motion takes time, and no arm is faster"
    )]
    pub acceleration_rad_per_s2: f64,
    /// Least clearance of the arm's links from the table, from each other and from the hand (m), by
    /// the URDF's collision shapes; `protocol` sets the tolerances of the hand alone. Half a centimeter:
    /// a typical calibration error.
    #[option(default = 0.005, range = 0.0..=MAX_NUMBER, why = "no arm is larger")]
    pub clearance_m: f64,
    /// Least singular value of the arm's Jacobian, in mixed meters and radians: below it the arm is
    /// too near a singularity, where joints turn fast while the hand moves slowly. At 0.02 a joint
    /// turns at 3.14 rad/s for 6 cm/s of the hand.
    #[option(
        default = 0.02, range = above(0.0, MAX_NUMBER),
        why = "at 0 the arm is singular, and no arm reaches farther"
    )]
    pub min_singular_value: f64,
}

impl ArmConfig {
    /// Returns the pose of the arm's base in the table's frame.
    ///
    /// # Errors
    ///
    /// Fails if the option's numbers are not a pose.
    pub fn table_from_base(&self) -> Result<Pose<Table, Base>, OptionFault> {
        Pose::from_array(self.table_from_base).map_err(|err| {
            let problem = err.to_string();
            OptionFault::new("arm.table_from_base", problem)
        })
    }

    fn pose_faults(&self, faults: &mut OptionFaults) {
        if !self.object_m.iter().all(|number| number.is_finite()) {
            faults.note(
                "object_m",
                format!("is {:?}, and must be finite", self.object_m),
            );
        }
        if let Err(fault) = self.table_from_base() {
            faults.note("table_from_base", fault.problem);
        }
    }
}
