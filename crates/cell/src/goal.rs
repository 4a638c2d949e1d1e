//! Goals, and the reasons for which a cell refuses them.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use motion::{JointTrack, PalmTrajectory};
use serde::{Deserialize, Serialize};
use simulation::Protocol;
use spatial::{Object, Pose, Table};

use crate::{
    PROTOCOL, points,
    wire::{self, WireError},
};

/// Hexadecimal digits of a goal's id, taken from the front of its digest.
const ID_DIGITS: usize = 32;

/// A motion for a cell to execute once.
#[derive(Debug, Clone, PartialEq)]
pub struct Goal {
    /// The motion's name in the lake.
    pub candidate_id: String,
    /// The object to be grasped, on the table in front of the robot.
    pub object: String,
    /// Digest of the robot's URDF ([`crate::robot_digest`]).
    pub robot: String,
    /// Number of this attempt; another number makes another goal of the same motion.
    pub attempt: u32,
    /// Number of times that this attempt was sent again because a person had stopped it.
    pub resumed: u32,
    /// Pose of the object on the table.
    pub table_from_object: Pose<Table, Object>,
    /// Largest difference of a joint from the first point when the motion starts, in radians.
    pub start_tolerance_rad: f64,
    /// Timing of the motion's phases, and the success criteria.
    pub grasp: Protocol,
    /// Trajectory of the palm or arm, to the end of the lift.
    pub carrier: PalmTrajectory,
    /// Trajectory of the fingers, to the end of the squeeze.
    pub hand: JointTrack,
}

/// A serialized goal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedGoal {
    /// The goal's id: the first 32 hexadecimal digits of the digest.
    pub goal_id: String,
    /// BLAKE3 of the content, in hexadecimal digits.
    pub digest: String,
    /// Sender and times, if given. They are not part of the content, so that a goal sent again
    /// later is the same goal.
    pub sending: Option<SendInfo>,
    /// The whole message.
    pub bytes: Vec<u8>,
}

/// A goal's sender and send time, by the sender's clock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SendInfo {
    /// The dispatcher's name in its heartbeats: the only ones that count while the goal executes.
    pub dispatcher: String,
    /// Send time, in milliseconds since 1970.
    pub sent_unix_ms: u64,
    /// Start deadline, in milliseconds since 1970.
    pub valid_until_unix_ms: u64,
}

/// First line of a goal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Seal {
    protocol: u32,
    goal_id: String,
    digest: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sending: Option<SendInfo>,
}

/// Largest clock difference between a dispatcher and a cell, in milliseconds.
pub(crate) const CLOCKS_MS: u64 = 1000;
/// Longest validity of a goal, in milliseconds: a day.
const MAX_VALID_MS: u64 = 86_400_000;

impl SendInfo {
    /// Returns the entry for `dispatcher` sending a goal now that may start within `valid`.
    pub fn now(dispatcher: &str, valid: Duration) -> Self {
        let sent_unix_ms = now_unix_ms();
        let valid_ms = u64::try_from(valid.as_millis()).unwrap_or(u64::MAX);
        Self {
            dispatcher: dispatcher.to_owned(),
            sent_unix_ms,
            valid_until_unix_ms: sent_unix_ms.saturating_add(valid_ms),
        }
    }

    /// Checks that a goal arrives in time.
    ///
    /// # Errors
    ///
    /// Fails with the cell's refusal, given the time by its own clock: `expired` for a goal that
    /// was delayed too long, `clock` where a delay cannot explain the times.
    pub fn check(&self, now_unix_ms: u64) -> Result<(), Rejection> {
        let (sent, until) = (self.sent_unix_ms, self.valid_until_unix_ms);
        let seconds = |from: u64, to: u64| to.saturating_sub(from) as f64 / 1000.0;
        let refuse = |code: RejectionCode, reason: String| Err(Rejection::new(code, reason));
        let valid_ms = until.saturating_sub(sent);
        if sent > now_unix_ms.saturating_add(CLOCKS_MS) {
            return refuse(
                RejectionCode::Clock,
                format!(
                    "by the cell's clock the goal was sent {} s in the future",
                    seconds(now_unix_ms, sent)
                ),
            );
        }
        if until < sent || valid_ms > MAX_VALID_MS {
            return refuse(
                RejectionCode::Clock,
                format!(
                    "the goal is valid until {} s after it was sent, expected 0 to {}",
                    until as f64 / 1000.0 - sent as f64 / 1000.0,
                    MAX_VALID_MS / 1000
                ),
            );
        }
        if now_unix_ms > until {
            let late_s = seconds(until, now_unix_ms);
            // The sender has waited for the whole validity without an answer.
            return if now_unix_ms - until > valid_ms.saturating_add(CLOCKS_MS) {
                refuse(
                    RejectionCode::Clock,
                    format!(
                        "by the cell's clock the goal expired {late_s} s ago; compare the clocks"
                    ),
                )
            } else {
                refuse(
                    RejectionCode::Expired,
                    format!("the goal came {late_s} s after the time until which it was valid"),
                )
            };
        }
        Ok(())
    }
}

/// Second line of a goal; its rows follow.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    candidate_id: String,
    object: String,
    robot: String,
    attempt: u32,
    #[serde(default, skip_serializing_if = "is_zero")]
    resumed: u32,
    table_from_object: [f64; 7],
    start_tolerance_rad: f64,
    grasp: Protocol,
    /// Controllers of the palm or arm, then of the hand: their rows follow in this order.
    controllers: [Controller; 2],
}

/// A controller and its number of rows.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, tag = "controller", rename_all = "snake_case")]
enum Controller {
    Palm {
        points_n: usize,
    },
    Arm {
        joints: Vec<String>,
        points_n: usize,
    },
    Hand {
        joints: Vec<String>,
        points_n: usize,
    },
}

impl Goal {
    /// Returns the end of the hold, in seconds.
    pub fn end_s(&self) -> f64 {
        let grasp = &self.grasp;
        grasp.reach_s + grasp.squeeze_s + grasp.pause_s + grasp.lift_s + grasp.hold_s
    }

    /// Returns the joint names: the arm's, if there is one, then the hand's. A report's numbers
    /// have the same order.
    pub fn joint_names(&self) -> Vec<String> {
        let arm = match &self.carrier {
            PalmTrajectory::Palm(_) => None,
            PalmTrajectory::Arm(arm) => Some(&arm.joints),
        };
        let joints = arm.into_iter().chain([&self.hand.joints]);
        joints.flatten().cloned().collect()
    }

    /// Serializes the goal and derives its id from the content.
    pub fn encode(&self) -> EncodedGoal {
        let mut content = wire::line(&Content {
            candidate_id: self.candidate_id.clone(),
            object: self.object.clone(),
            robot: self.robot.clone(),
            attempt: self.attempt,
            resumed: self.resumed,
            table_from_object: self.table_from_object.to_array(),
            start_tolerance_rad: self.start_tolerance_rad,
            grasp: self.grasp.clone(),
            controllers: [
                match &self.carrier {
                    PalmTrajectory::Palm(points) => Controller::Palm {
                        points_n: points.len(),
                    },
                    PalmTrajectory::Arm(arm) => Controller::Arm {
                        joints: arm.joints.clone(),
                        points_n: arm.points.len(),
                    },
                },
                Controller::Hand {
                    joints: self.hand.joints.clone(),
                    points_n: self.hand.points.len(),
                },
            ],
        });
        match &self.carrier {
            PalmTrajectory::Palm(palm) => points::push_palm(palm, &mut content),
            PalmTrajectory::Arm(arm) => points::push_joints(&arm.points, &mut content),
        }
        points::push_joints(&self.hand.points, &mut content);
        let digest = blake3::hash(&content).to_hex().to_string();
        EncodedGoal::new(digest, None, &content)
    }
}

impl EncodedGoal {
    fn new(digest: String, sending: Option<SendInfo>, content: &[u8]) -> Self {
        let goal_id = id_of(&digest);
        let mut bytes = wire::line(&Seal {
            protocol: PROTOCOL,
            goal_id: goal_id.clone(),
            digest: digest.clone(),
            sending: sending.clone(),
        });
        bytes.extend_from_slice(content);
        Self {
            goal_id,
            digest,
            sending,
            bytes,
        }
    }

    /// Returns the same goal with its sender and send time.
    #[must_use]
    pub fn sent(&self, sending: SendInfo) -> Self {
        let end = self.bytes.iter().position(|&byte| byte == b'\n');
        let content = end.and_then(|end| self.bytes.get(end + 1..));
        let content = content.unwrap_or_default();
        Self::new(self.digest.clone(), Some(sending), content)
    }

    /// Parses a goal and checks that it is intact: version, digest, id and form.
    ///
    /// # Errors
    ///
    /// Fails with the cell's refusal of such a message.
    pub fn decode(bytes: &[u8]) -> Result<(Self, Goal), Rejection> {
        let (seal, content): (Seal, &[u8]) = wire::split_line("seal", bytes)?;
        if seal.protocol != PROTOCOL {
            return Err(Rejection::new(
                RejectionCode::Protocol,
                format!(
                    "the cell speaks version {PROTOCOL}, the goal {}",
                    seal.protocol
                ),
            ));
        }
        let digest = blake3::hash(content).to_hex().to_string();
        if seal.digest != digest || seal.goal_id != id_of(&digest) {
            return Err(Rejection::new(
                RejectionCode::Digest,
                "digest and id are not those of the content".to_owned(),
            ));
        }
        let goal = read(content)?;
        let encoded = Self {
            goal_id: seal.goal_id,
            digest,
            sending: seal.sending,
            bytes: bytes.to_vec(),
        };
        Ok((encoded, goal))
    }
}

/// Returns the time used for expiry checks.
#[expect(
    clippy::disallowed_methods,
    reason = "a goal's end is exchanged between two machines, and is in no artifact"
)]
pub(crate) fn now() -> SystemTime {
    SystemTime::now()
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_zero(number: &u32) -> bool {
    *number == 0
}

/// Returns that time in milliseconds since 1970.
pub(crate) fn now_unix_ms() -> u64 {
    let since_1970 = now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since_1970.as_millis()).unwrap_or(u64::MAX)
}

fn id_of(digest: &str) -> String {
    digest.chars().take(ID_DIGITS).collect()
}

fn read(bytes: &[u8]) -> Result<Goal, WireError> {
    let (content, numbers): (Content, &[u8]) = wire::split_line("content", bytes)?;
    let poses = content.table_from_object;
    let (table_from_object, _) = wire::pose(0, &poses)?;
    let [carrier, hand] = content.controllers;
    let (carrier, numbers) = match carrier {
        Controller::Palm { points_n } => {
            let (palm, rest) = points::read_palm(points_n, numbers)?;
            (PalmTrajectory::Palm(palm), rest)
        }
        Controller::Arm { joints, points_n } => {
            let (arm, rest) = points::read_joints(joints, points_n, numbers)?;
            (PalmTrajectory::Arm(arm), rest)
        }
        Controller::Hand { .. } => return Err(order("a hand moves no palm")),
    };
    let Controller::Hand { joints, points_n } = hand else {
        return Err(order("the second controller is not a hand"));
    };
    let (hand, rest) = points::read_joints(joints, points_n, numbers)?;
    if !rest.is_empty() {
        return Err(WireError::Rows {
            bytes: rest.len(),
            width: 0,
        });
    }
    Ok(Goal {
        candidate_id: content.candidate_id,
        object: content.object,
        robot: content.robot,
        attempt: content.attempt,
        resumed: content.resumed,
        table_from_object,
        start_tolerance_rad: content.start_tolerance_rad,
        grasp: content.grasp,
        carrier,
        hand,
    })
}

fn order(message: &str) -> WireError {
    WireError::Json {
        part: "controllers",
        message: message.to_owned(),
    }
}

/// Reason why a cell did not take a goal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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
    use motion::{JointPoint, JointRates, PalmPoint};
    use nalgebra::{Isometry3, Vector3};
    use simulation::{Approach, ProtocolName, PullConfig, StrictConfig, Trial};
    use spatial::Twist;

    use super::*;

    /// Grasp parameters without knowledge of the hand.
    fn grasp() -> Protocol {
        Protocol {
            approach: Approach::Follow,
            reach_s: 1.0,
            close_fraction: 0.2,
            flexion_joints: Vec::new(),
            open_rad: 0.0,
            squeeze_rad: 0.3,
            squeeze_s: 0.2,
            pause_s: 0.1,
            lift_m: 0.1,
            lift_s: 0.5,
            hold_s: 0.5,
            lifted_m: 0.05,
            min_links: 2,
            max_slip_m_per_s: 0.02,
            knocked_m: 0.03,
            knocked_rad: 0.5,
            limit_tolerance_rad: 0.01,
            table_tolerance_m: 0.002,
            early_tolerance_m: 0.005,
            trial: Trial::Lift,
            strict: StrictConfig::default(),
            pull: PullConfig::default(),
            name: ProtocolName::TableLift,
            published: None,
        }
    }

    fn goal() -> Goal {
        let palm = |time_s: f64| PalmPoint {
            time_s,
            table_from_palm: Pose::new(Isometry3::new(
                Vector3::new(0.1, -0.2, 0.3),
                Vector3::new(0.3 * time_s, 0.0, 0.1),
            )),
            velocity: Twist::from_array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]),
            acceleration: Twist::zero(),
        };
        let hand = |time_s: f64| JointPoint {
            time_s,
            q_rad: vec![0.1 * time_s, -0.7],
            rates: JointRates {
                velocity: vec![0.1, 0.0],
                acceleration: vec![0.0, 1.0 / 3.0],
            },
        };
        Goal {
            candidate_id: "can-0001".to_owned(),
            object: "can".to_owned(),
            robot: crate::robot_digest("<robot/>"),
            attempt: 1,
            resumed: 0,
            table_from_object: Pose::identity(),
            start_tolerance_rad: 0.1,
            grasp: grasp(),
            carrier: PalmTrajectory::Palm(vec![palm(0.0), palm(1.0)]),
            hand: JointTrack {
                joints: vec!["a".to_owned(), "b\n\"".to_owned()],
                points: vec![hand(0.0), hand(0.5), hand(1.0)],
            },
        }
    }

    fn code(bytes: &[u8]) -> RejectionCode {
        EncodedGoal::decode(bytes).unwrap_err().code
    }

    #[test]
    fn sealed_goal_round_trips() {
        let encoded = goal().encode();
        let (again, opened) = EncodedGoal::decode(&encoded.bytes).unwrap();
        assert_eq!(again, encoded);
        assert_eq!(opened.encode(), encoded);
        let arm = Goal {
            carrier: PalmTrajectory::Arm(goal().hand),
            ..goal()
        };
        let (_, again) = EncodedGoal::decode(&arm.encode().bytes).unwrap();
        assert_eq!(again, arm);
        assert_eq!(opened.hand.points.len(), 3);
        let PalmTrajectory::Palm(points) = opened.carrier else {
            panic!("a palm was sent");
        };
        assert_eq!(points.len(), 2);
    }

    #[test]
    fn every_number_of_a_goal_arrives_to_the_last_bit() {
        let mut reader = blake3::Hasher::new().update(b"goals").finalize_xof();
        for _ in 0..500 {
            let mut drawn = || {
                let mut bytes = [0; 8];
                reader.fill(&mut bytes);
                (0.5 + (u64::from_le_bytes(bytes) >> 11) as f64) / (1_u64 << 53) as f64
            };
            let goal = Goal {
                start_tolerance_rad: drawn(),
                grasp: Protocol {
                    reach_s: drawn(),
                    squeeze_rad: drawn(),
                    lift_m: drawn(),
                    hold_s: drawn(),
                    knocked_m: drawn(),
                    ..grasp()
                },
                ..goal()
            };
            let encoded = goal.encode();
            let (_, opened) = EncodedGoal::decode(&encoded.bytes).unwrap();
            assert_eq!(opened.grasp, goal.grasp);
            let tolerances = [&opened, &goal].map(|goal| goal.start_tolerance_rad.to_bits());
            assert_eq!(tolerances[0], tolerances[1]);
            assert_eq!(opened.encode(), encoded);
        }
    }

    #[test]
    fn the_id_follows_from_the_content() {
        let first = goal();
        let mut second = goal();
        assert_eq!(first.encode().goal_id, second.encode().goal_id);
        second.attempt = 2;
        assert_ne!(first.encode().goal_id, second.encode().goal_id);
        // The same attempt, sent again after it was stopped.
        let resumed = Goal {
            resumed: 1,
            ..goal()
        };
        assert_ne!(first.encode().goal_id, resumed.encode().goal_id);
        let (_, again) = EncodedGoal::decode(&resumed.encode().bytes).unwrap();
        assert_eq!(again, resumed);
        let mut third = goal();
        third.hand.points[1].q_rad[0] = 0.051;
        assert_ne!(first.encode().goal_id, third.encode().goal_id);
    }

    #[test]
    fn a_goal_changed_or_cut_anywhere_is_refused() {
        let bytes = goal().encode().bytes;
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(EncodedGoal::decode(&changed).is_err(), "byte {at} changed");
            assert!(EncodedGoal::decode(&bytes[..at]).is_err(), "cut at {at}");
        }
    }

    #[test]
    fn goal_is_independent_of_sender_and_time() {
        let first = goal().encode();
        let sending = SendInfo::now("me", Duration::from_secs(1));
        let sent = first.sent(sending.clone());
        assert_eq!(
            (&sent.goal_id, &sent.digest),
            (&first.goal_id, &first.digest)
        );
        let (again, _) = EncodedGoal::decode(&sent.bytes).unwrap();
        assert_eq!(again, sent);
        assert_eq!(again.sending, Some(sending));
        assert_eq!(first.sending, None);
    }

    #[test]
    fn late_goal_is_distinguished_from_clock_offset() {
        const NOW: u64 = 1_800_000_000_000;
        let code = |sent: i64, until: i64| {
            let at = |offset: i64| NOW.saturating_add_signed(offset);
            let sending = SendInfo {
                dispatcher: "me".to_owned(),
                sent_unix_ms: at(sent),
                valid_until_unix_ms: at(until),
            };
            sending.check(NOW).err().map(|refused| refused.code)
        };
        let (clock, expired) = (Some(RejectionCode::Clock), Some(RejectionCode::Expired));
        for (sent, until, expected) in [
            (0, 10_000, None),
            (-9_999, 1, None),
            (900, 10_900, None),
            (-10_001, -1, expired),
            (-20_000, -10_000, expired),
            (-22_000, -12_000, clock),
            (-3_600_000, -3_590_000, clock),
            (1_001, 11_001, clock),
            (3_600_000, 3_610_000, clock),
            (0, 86_400_001, clock),
            (0, i64::MAX, clock),
            (0, -1, clock),
            (i64::MIN, i64::MIN, clock),
        ] {
            assert_eq!(code(sent, until), expected, "{sent} to {until}");
        }
    }

    #[test]
    fn refusals_name_the_reason() {
        assert_eq!(code(b""), RejectionCode::Malformed);
        assert_eq!(code(b"{}\n{}\n"), RejectionCode::Malformed);
        let mut strange = goal();
        strange.hand.points[2].time_s = f64::NAN;
        assert_eq!(code(&strange.encode().bytes), RejectionCode::Malformed);
        let text = String::from_utf8_lossy(&goal().encode().bytes).replacen(
            &format!("\"protocol\":{PROTOCOL}"),
            "\"protocol\":9",
            1,
        );
        assert_eq!(code(text.as_bytes()), RejectionCode::Protocol);
    }
}
