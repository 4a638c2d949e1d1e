//! What a cell says that it can do, and its short answers.

use serde::{Deserialize, Serialize};

use crate::goal::Rejection;

/// What a cell can do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Capabilities {
    /// Version of the protocol.
    pub protocol: u32,
    /// The cell's name.
    pub cell: String,
    /// Name of the journal in which it writes down what it takes: the public key with which all of its
    /// answers are signed.
    pub journal: String,
    /// The time by the cell's clock, in milliseconds since 1970.
    pub clock_unix_ms: u64,
    /// Whether nothing real moves.
    pub simulated: bool,
    /// Digest of the robot's URDF ([`crate::robot_digest`]).
    pub robot: String,
    /// The robot's controllers: what moves the palm, then the hand.
    pub controllers: Vec<Offer>,
    /// What a palm that flies can do, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub palm: Option<PalmLimits>,
    /// Pose of the arm's foot in the table's frame, if the cell has an arm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table_from_base: Option<[f64; 7]>,
    /// Longest goal accepted, in bytes.
    pub max_goal_bytes: usize,
    /// What is known about how it differs from what was planned for, for people.
    pub gap: String,
    /// Whether a motion takes as long as it says; a simulated cell may be faster.
    pub real_time: bool,
    /// Longest time without a heartbeat before a motion is broken off, in seconds; never if absent.
    pub silence_s: Option<f64>,
}

/// A controller that a cell has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Offer {
    /// `palm` of a hand that flies, `arm`, or `hand`.
    pub controller: String,
    /// Names of its joints; a palm has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<String>,
    /// How often it is told something, in 1/s.
    pub rate_hz: f64,
}

/// Limits of a palm that flies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PalmLimits {
    /// Largest speed, in m/s.
    pub speed_m_per_s: f64,
    /// Largest acceleration, in m/s².
    pub acceleration_m_per_s2: f64,
    /// Largest angular speed, in rad/s.
    pub turn_rad_per_s: f64,
    /// Largest angular acceleration, in rad/s².
    pub turn_acceleration_rad_per_s2: f64,
    /// Least and greatest coordinates of its origin, along the table's axes in meters.
    pub workspace_m: [[f64; 3]; 2],
}

/// A cell's reply to a goal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "answer")]
pub(crate) enum GoalAnswer {
    /// It executes the goal, or has done so.
    Accepted {
        /// Whether it had taken the goal before, so that nothing moves because of this answer.
        known: bool,
    },
    /// It does not.
    Rejected(Rejection),
}

/// A cell's reply to a cancel request, or goals taken again, or a report that
/// there is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "answer", deny_unknown_fields)]
pub(crate) enum Word {
    /// It is done: nothing of the motion moves any more.
    Done,
    /// The motion was over before.
    Over,
    /// The cell never took that goal.
    NeverTaken,
}
