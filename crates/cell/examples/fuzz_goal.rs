//! Feeds damaged goals to the decoder for a while:
//! `cargo run --release -p cell --example fuzz_goal -- [SECONDS [SEED]]`.
//!
//! Half of them have the digest and the signature of what they hold, so that the damage reaches what
//! lies behind the seal. A decoder that panics, or opens what does not come out as it went in, ends the program.

#![expect(clippy::print_stdout, reason = "an example for a terminal")]

use std::{
    env,
    error::Error,
    time::{Duration, Instant},
};

use cell::{
    Address, EncodedGoal, Goal, GoalMessage, JointPoint, JointRates, JointTrack, PalmPoint,
    PalmTrajectory, SigningKey, robot_digest,
};
use nalgebra::Isometry3;
use spatial::{Pose, Twist};

/// Pieces that mean something to the decoder.
const PIECES: [&[u8]; 12] = [
    b"\n",
    b"{",
    b"}",
    b"\"",
    b"null",
    b"-1e999",
    b"NaN",
    b"[]",
    &[0xff; 8],
    &[0; 8],
    b"\"points_n\":",
    b"\xf0\x9f\x92\xa5",
];

/// Numbers drawn one after another (Marsaglia, *Xorshift RNGs*, 2003, section 3).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 % (n.max(1) as u64)).unwrap_or(0)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let seconds = env::args().nth(1).map_or(Ok(60), |text| text.parse())?;
    let deadline = Instant::now() + Duration::from_secs(seconds);
    let key = SigningKey::fresh()?;
    let content = goal()?.encode().bytes;
    let whole = sealed(&content, &key);
    let seed = env::args()
        .nth(2)
        .map_or(Ok(1), |text| text.parse::<u64>())?;
    let mut numbers = Numbers(0x2026_1122 ^ (seed << 32));
    let (mut n, mut opened_n) = (0_u64, 0_u64);
    while Instant::now() < deadline {
        for _ in 0..1000 {
            let bytes = if numbers.below(2) == 0 {
                damaged(&whole, &mut numbers)
            } else {
                sealed(&damaged(&content, &mut numbers), &key)
            };
            n += 1;
            if let Ok((_, goal)) = GoalMessage::decode(&bytes) {
                opened_n += 1;
                let again = goal.encode();
                let (_, same) = EncodedGoal::decode(&again.bytes)
                    .map_err(|err| format!("opened once, and then {err}"))?;
                if !is_same(&same, &goal) {
                    return Err(format!("opened as {goal:?}, and then as {same:?}").into());
                }
            }
        }
    }
    println!("{n} damaged goals in {seconds} s, of which {opened_n} were goals still");
    Ok(())
}

fn goal() -> Result<Goal, Box<dyn Error>> {
    let palm = |time_s: f64| PalmPoint {
        time_s,
        table_from_palm: Pose::new(Isometry3::translation(0.1, time_s, 0.2)),
        velocity: Twist::from_array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        acceleration: Twist::zero(),
    };
    let hand = |time_s: f64| JointPoint {
        time_s,
        q_rad: vec![0.1, time_s],
        rates: JointRates {
            velocity: vec![0.0, 1.0],
            acceleration: vec![0.0; 2],
        },
    };
    Ok(Goal {
        candidate_id: "cube-0001".to_owned(),
        object: "cube".to_owned(),
        robot: robot_digest("<robot/>"),
        attempt: 1,
        resumed: 0,
        table_from_object: Pose::identity(),
        start_tolerance_rad: 0.1,
        grasp: serde_json::from_str(include_str!("grasp.json"))?,
        carrier: PalmTrajectory::Palm(vec![palm(0.0), palm(0.5)]),
        hand: JointTrack {
            joints: vec!["a".to_owned(), "b".to_owned()],
            points: vec![hand(0.0), hand(0.5), hand(1.0)],
        },
    })
}

/// Whether two goals are the same but for the rounding with which a rotation is made one.
fn is_same(a: &Goal, b: &Goal) -> bool {
    let is_near = |a: &[f64; 7], b: &[f64; 7]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    let carried = match (&a.carrier, &b.carrier) {
        (PalmTrajectory::Palm(a), PalmTrajectory::Palm(b)) => {
            a.len() == b.len()
                && a.iter().zip(b).all(|(a, b)| {
                    let [pose_a, pose_b] = [a, b].map(|point| point.table_from_palm.to_array());
                    a.time_s.to_bits() == b.time_s.to_bits()
                        && is_near(&pose_a, &pose_b)
                        && (a.velocity, a.acceleration) == (b.velocity, b.acceleration)
                })
        }
        (a, b) => a == b,
    };
    let [lying_a, lying_b] = [a, b].map(|goal| goal.table_from_object.to_array());
    carried
        && is_near(&lying_a, &lying_b)
        && a.hand == b.hand
        && (&a.candidate_id, &a.object, &a.robot, a.attempt)
            == (&b.candidate_id, &b.object, &b.robot, b.attempt)
        && a.grasp == b.grasp
        && a.start_tolerance_rad.to_bits() == b.start_tolerance_rad.to_bits()
}

/// The message with this content, whatever it is.
fn sealed(content: &[u8], key: &SigningKey) -> Vec<u8> {
    let digest = blake3::hash(content).to_hex().to_string();
    let encoded = EncodedGoal {
        goal_id: digest.get(..32).unwrap_or_default().to_owned(),
        digest,
        bytes: content.to_vec(),
    };
    let address = Address::now("lab", "00", "me", true, Duration::from_secs(1));
    GoalMessage::new(encoded, address, key).bytes
}

/// Changes, drops, doubles or puts in a few bytes.
fn damaged(bytes: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..=numbers.below(4) {
        let at = numbers.below(bytes.len() + 1);
        let end = (at + numbers.below(40)).min(bytes.len());
        match numbers.below(5) {
            0 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = u8::try_from(numbers.below(256)).unwrap_or(0);
                }
            }
            1 => drop(bytes.drain(at..end)),
            2 => {
                let piece = bytes.get(at..end).unwrap_or_default().to_vec();
                bytes.splice(at..at, piece);
            }
            3 => {
                let piece = PIECES.get(numbers.below(PIECES.len())).copied();
                bytes.splice(at..at, piece.unwrap_or_default().iter().copied());
            }
            _ => bytes.truncate(at),
        }
    }
    bytes
}
