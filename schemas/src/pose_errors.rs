//! `pose_errors`: whether motions, accepted or not, hold where the object lies off its estimated pose, one partition
//! per object, one row per motion and size of the error.
//!
//! The object is `position_m` off in a direction on the table that is drawn for each motion, and turned by `yaw_rad`
//! one way or the other about the vertical through its origin.

use crate::{columns::columns, rollouts::Verdict, table::table};

columns! {
    /// One motion under an error of one size.
    #[derive(Debug, Clone, PartialEq)]
    pub struct PoseErrorTrial {
        candidate_id: String => "the motion",
        position_m: f64 ["m"] => "distance of the object's estimated from its true position on the table",
        yaw_rad: f64 ["rad"] => "angle of its estimated from its true yaw",
        + success: bool = |trial| trial.verdict == Verdict::Held
            => "lifted, held to the end and still in contact",
        verdict as reason: Verdict => "`held`, or why it failed",
        control_steps_n: i64 => "simulated control steps",
    }
}

/// The motions of one object under errors of its pose.
pub type PoseErrors = Vec<PoseErrorTrial>;
table! {"pose_errors", 1, per "object", rows: PoseErrorTrial}
