//! A cell's capabilities and its short answers.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{Rejection, text::plain_line};

/// Capabilities of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Capabilities {
    /// Protocol version.
    pub protocol: u32,
    /// The cell's name.
    pub cell: String,
    /// Name of the cell's goal journal: the public key that verifies all of its answers.
    pub journal: String,
    /// Time by the cell's clock, in milliseconds since 1970.
    pub clock_unix_ms: u64,
    /// Whether the cell is a simulation: no hardware moves.
    pub simulated: bool,
    /// Whether goals are refused until a person resumes the cell.
    pub stopped: bool,
    /// Id of the goal that is being executed; empty if none is.
    pub executing: String,
    /// Digest of the robot's URDF ([`crate::robot_digest`]).
    pub robot: String,
    /// The robot's controllers: the palm's or arm's, then the hand's.
    pub controllers: Vec<ControllerInfo>,
    /// Limits of the palm, if the hand is free-flying.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub palm: Option<PalmLimits>,
    /// Pose of the arm's base in the table's frame, if the cell has an arm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table_from_base: Option<[f64; 7]>,
    /// Longest goal accepted, in bytes.
    pub max_goal_bytes: usize,
    /// Known differences from the planning model, as text for people.
    pub gap: String,
    /// Whether motions run in real time; a simulated cell may be faster.
    pub real_time: bool,
    /// Heartbeat timeout before a motion is aborted, in seconds; no timeout if absent.
    pub silence_s: Option<f64>,
}

impl Capabilities {
    /// Returns the contradiction of these capabilities with themselves, if there is one.
    pub(crate) fn contradiction(&self) -> Option<PalmLimitFault> {
        let PalmLimits {
            speed_m_per_s,
            acceleration_m_per_s2,
            turn_rad_per_s,
            turn_acceleration_rad_per_s2,
            workspace_m: [least, most],
        } = self.palm?;
        let limits = [
            ("speed_m_per_s", speed_m_per_s),
            ("acceleration_m_per_s2", acceleration_m_per_s2),
            ("turn_rad_per_s", turn_rad_per_s),
            ("turn_acceleration_rad_per_s2", turn_acceleration_rad_per_s2),
        ];
        if let Some(&(name, limit)) = limits.iter().find(|(_, limit)| *limit <= 0.0) {
            return Some(PalmLimitFault::NotPositive { name, limit });
        }
        let is_inverted = least.iter().zip(&most).any(|(least, most)| least >= most);
        is_inverted.then_some(PalmLimitFault::Workspace { least, most })
    }

    /// Returns what differs from an earlier answer, if anything does but the clock, a stop and the goal
    /// in execution.
    pub fn change_since(&self, earlier: &Self) -> Option<CapabilityChange> {
        let as_earlier = Self {
            clock_unix_ms: earlier.clock_unix_ms,
            stopped: earlier.stopped,
            executing: earlier.executing.clone(),
            ..self.clone()
        };
        if as_earlier == *earlier {
            return None;
        }
        let fields = [self, earlier].map(|cell| serde_json::to_value(cell).unwrap_or_default());
        let [now, before] = fields.each_ref().map(serde_json::Value::as_object);
        let ignored = ["clock_unix_ms", "stopped", "executing"];
        let keys = now
            .into_iter()
            .chain(before)
            .flat_map(|fields| fields.keys());
        let differing = keys
            .filter(|key| !ignored.contains(&key.as_str()))
            .find_map(|key| {
                let [now, before] = [now, before].map(|fields| fields.and_then(|it| it.get(key)));
                (now != before).then(|| CapabilityChange::Field {
                    name: key.clone(),
                    before: before.cloned(),
                    now: now.cloned(),
                })
            });
        differing.or(Some(CapabilityChange::Unnamed))
    }
}

/// A contradiction of a palm's limits with themselves.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PalmLimitFault {
    /// A limit lets nothing move.
    #[error("`palm.{name}` is {limit}, expected more than 0")]
    NotPositive {
        /// The limit's key, with its unit.
        name: &'static str,
        /// Its value.
        limit: f64,
    },
    /// The workspace is empty.
    #[error(
        "`palm.workspace_m` begins at {least:?} and ends at {most:?}: its least corner comes first"
    )]
    Workspace {
        /// Its first corner, in meters.
        least: [f64; 3],
        /// Its second corner, in meters.
        most: [f64; 3],
    },
}

/// The first difference of a cell's capabilities from earlier ones.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum CapabilityChange {
    /// A field has another value.
    Field {
        /// The field's name.
        name: String,
        /// Its value before, if it was there.
        before: Option<serde_json::Value>,
        /// Its value now, if it is there.
        now: Option<serde_json::Value>,
    },
    /// They differ in no field of a message, e.g. in a number that JSON cannot write.
    Unnamed,
}

impl fmt::Display for CapabilityChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Field { name, before, now } => {
                let [before, now] = [before, now].map(|value| {
                    let text = value.as_ref().map(ToString::to_string);
                    plain_line(text.as_deref().unwrap_or("absent"))
                });
                write!(f, "`{name}` was {before} and is {now}")
            }
            Self::Unnamed => f.write_str("its capabilities changed"),
        }
    }
}

/// A controller of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ControllerInfo {
    /// `palm` of a free-flying hand, `arm`, or `hand`.
    pub controller: String,
    /// Names of its joints; a palm has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<String>,
    /// Command rate, in 1/s.
    pub rate_hz: f64,
}

/// Limits of the palm of a free-flying hand.
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
    /// Least and greatest coordinates of the palm's origin, along the table's axes in meters.
    pub workspace_m: [[f64; 3]; 2],
}

/// A cell's reply to a goal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "answer")]
pub(crate) enum GoalAnswer {
    /// The cell executes the goal, or has done so.
    Accepted {
        /// Whether the goal had been accepted before, so that nothing moves because of this answer.
        known: bool,
    },
    /// The cell refuses the goal.
    Rejected(Rejection),
}

/// A cell's reply to a cancel, stop or resume request, or its answer where no report exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "answer", deny_unknown_fields)]
pub(crate) enum Acknowledgment {
    /// Done: the motion has stopped.
    Done,
    /// The motion had already ended.
    Over,
    /// The cell never accepted that goal.
    NeverTaken,
}
