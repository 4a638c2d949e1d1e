//! Refusals of goals.

use serde::{
    Deserialize, Serialize,
    de::value::{Error as ValueError, StrDeserializer},
};

use crate::{text::plain_line, wire::WireError};

/// Reason why a cell did not take a goal: nothing has moved because of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "RejectionMessage")]
pub struct Rejection {
    /// The reason for programs.
    pub code: RejectionCode,
    /// The reason for people.
    pub reason: String,
}

/// The reasons for which a cell refuses a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RejectionCode {
    /// The message exceeds the cell's maximum length.
    TooLarge,
    /// The message is not a goal.
    Malformed,
    /// The goal has another protocol version.
    Protocol,
    /// The goal's digest or id does not match its content.
    Digest,
    /// The goal's signature is not that of its dispatcher, or the cell does not take goals from it.
    Dispatcher,
    /// The goal is for another cell or journal.
    Address,
    /// The goal may move nothing real, and the cell would.
    Permission,
    /// The goal is for another robot.
    Robot,
    /// The goal's controllers differ from the cell's, or do not name exactly the robot's joints.
    Joints,
    /// A position, velocity, acceleration or tolerance is outside the robot's limits.
    Limits,
    /// The times do not increase, or there are too few or too many steps.
    Times,
    /// The object is not in front of the robot.
    Object,
    /// The cell executes another goal.
    Busy,
    /// The goal's start deadline has passed.
    Expired,
    /// The clocks of dispatcher and cell disagree.
    Clock,
    /// The cell was stopped and has not been resumed.
    Stopped,
    /// The cell cannot journal the goal.
    Storage,
    /// A code that the protocol does not list; the reason begins with it.
    Unlisted,
}

/// A refusal as received.
#[derive(Deserialize)]
struct RejectionMessage {
    code: String,
    reason: String,
}

impl From<RejectionMessage> for Rejection {
    fn from(RejectionMessage { code, reason }: RejectionMessage) -> Self {
        let listed = StrDeserializer::<ValueError>::new(&code);
        match RejectionCode::deserialize(listed) {
            Ok(code) if code != RejectionCode::Unlisted => Self::new(code, plain_line(&reason)),
            Ok(_) | Err(_) => Self::new(
                RejectionCode::Unlisted,
                plain_line(&format!("{code}: {reason}")),
            ),
        }
    }
}

impl Rejection {
    /// Creates a refusal with its reason.
    pub fn new(code: RejectionCode, reason: String) -> Self {
        Self { code, reason }
    }
}

impl From<WireError> for Rejection {
    fn from(err: WireError) -> Self {
        Self::new(RejectionCode::Malformed, err.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unlisted_code_is_a_refusal_and_is_named() {
        let read = |text: &str| serde_json::from_str::<Rejection>(text).unwrap();
        let refused = read(r#"{"code":"too_large","reason":"9 bytes"}"#);
        assert_eq!(refused.code, RejectionCode::TooLarge);
        for code in ["estop", "unlisted", "\\u202e"] {
            let refused = read(&format!(r#"{{"code":"{code}","reason":"no\n"}}"#));
            assert_eq!(refused.code, RejectionCode::Unlisted, "{code}");
            assert_eq!(
                refused.reason,
                format!("{}: no\\n", code.replace("\\u202e", "\\u{202e}"))
            );
        }
    }
}
