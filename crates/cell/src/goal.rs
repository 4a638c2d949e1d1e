//! Goals: a motion for a cell to execute once.

use motion::{JointTrack, PalmTrajectory};
use serde::{Deserialize, Serialize};
use spatial::{Object, Pose, Table};

use crate::{
    Grasp, points,
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
    pub grasp: Grasp,
    /// Trajectory of the palm or arm, to the end of the lift.
    pub carrier: PalmTrajectory,
    /// Trajectory of the fingers, to the end of the squeeze.
    pub hand: JointTrack,
}

/// A serialized goal, not yet addressed to a cell.
///
/// Its bytes are those of version 4: a motion keeps the id under which cells remember it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedGoal {
    /// The goal's id: the first 32 hexadecimal digits of the digest.
    pub goal_id: String,
    /// BLAKE3 of the bytes, in hexadecimal digits.
    pub digest: String,
    /// The line of the motion and its rows.
    pub bytes: Vec<u8>,
}

/// Line of the motion; its rows follow.
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
    grasp: Grasp,
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
        self.grasp.end_s()
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
        EncodedGoal::of(content)
    }
}

impl EncodedGoal {
    fn of(bytes: Vec<u8>) -> Self {
        let digest = blake3::hash(&bytes).to_hex().to_string();
        Self {
            goal_id: digest.chars().take(ID_DIGITS).collect(),
            digest,
            bytes,
        }
    }

    /// Parses a goal.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a goal.
    pub fn decode(bytes: &[u8]) -> Result<(Self, Goal), WireError> {
        Ok((Self::of(bytes.to_vec()), read(bytes)?))
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_zero(number: &u32) -> bool {
    *number == 0
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

#[cfg(test)]
pub(crate) mod tests {
    use motion::{JointPoint, JointRates, PalmPoint};
    use nalgebra::{Isometry3, Vector3};
    use spatial::Twist;

    use super::*;
    use crate::{
        Approach,
        grasp::{Pull, Strict, Trial},
    };

    /// Grasp parameters without knowledge of the hand.
    fn grasp() -> Grasp {
        Grasp {
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
            strict: Strict::default(),
            trial: Trial::Lift,
            pull: Pull::default(),
        }
    }

    pub(crate) fn goal() -> Goal {
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

    #[test]
    fn a_goal_round_trips() {
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
                grasp: Grasp {
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

    /// A rotation that is not quite one is made one when it is parsed: the id is that of the bytes.
    #[test]
    fn a_parsed_goal_keeps_the_id_of_its_bytes() {
        let sent = goal().encode();
        let text = String::from_utf8_lossy(&sent.bytes);
        let off = text.replacen("0.0,0.0,0.0,1.0]", "0.0,0.0,0.0,0.9999999]", 1);
        assert_ne!(off, text);
        let rest = sent.bytes.get(text.find('\n').unwrap()..).unwrap();
        let line = off.lines().next().unwrap().as_bytes();
        let bytes = [line, rest].concat();
        let (encoded, parsed) = EncodedGoal::decode(&bytes).unwrap();
        assert_eq!(encoded.digest, blake3::hash(&bytes).to_hex().as_str());
        assert_ne!(parsed.encode().goal_id, encoded.goal_id);
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
}
