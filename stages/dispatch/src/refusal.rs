//! Why a motion is not sent.

use std::fmt;

use robot::WrongDof;

/// Why a motion is not sent; nothing of it has moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    /// There is nothing to move between.
    #[error("not sent: {found} steps, expected at least 2")]
    Steps { found: usize },
    /// A number is missing, NaN or infinite.
    #[error("not sent: step {step} has a number that is missing or not finite")]
    Number { step: usize },
    /// Times do not increase.
    #[error("not sent: step {step} is at {time_s} s, not after {last_s} s")]
    Times {
        step: usize,
        time_s: f64,
        last_s: f64,
    },
    /// No rotation vector is that of the turn.
    #[error("not sent: the palm's turn before step {step} cannot be followed")]
    Turn { step: usize },
    /// The steps are those of another hand.
    #[error("not sent: its joints are not those of the hand: `{joint}`")]
    Joints { joint: String },
    /// The motion has another number of joints than the hand.
    #[error("not sent: {0}")]
    Dof(#[from] WrongDof),
    /// A joint's position.
    #[error(
        "not sent: joint `{joint}` would be at {q:.4} after {time_s:.3} s, outside {lower:.4} to {upper:.4}"
    )]
    Limit {
        joint: String,
        q: f64,
        time_s: f64,
        lower: f64,
        upper: f64,
    },
    /// The hand's shapes and the table.
    #[error("not sent: link `{link}` would be {depth_m:.4} m below the table after {time_s:.3} s")]
    Table {
        link: String,
        depth_m: f64,
        time_s: f64,
    },
    /// The limits ask for too much time.
    #[error(
        "not sent: within its limits the motion takes {slower:.2} times as long, more than `limits.most_times_slower` = {most}"
    )]
    Slow { slower: f64, most: f64 },
    /// The cell takes no message that long.
    #[error("not sent: its goal has {bytes} bytes, more than the {most} that the cell takes")]
    Long { bytes: usize, most: usize },
    /// No posture of the arm is that of the way's end.
    #[error(
        "not sent: the arm cannot bring the palm to the grasp, {} m from its foot, at any of {turns} turns of the object",
        numbers(palm_in_base_m)
    )]
    Reach {
        /// Where it is with the object as it was screened, along the axes of the arm's foot.
        palm_in_base_m: [f64; 3],
        turns: usize,
    },
    /// The arm comes to the grasp, but not all the way.
    #[error(
        "not sent: the arm cannot follow in any of {postures} postures at {turns} turns of the object; at best {fault}"
    )]
    Arm {
        postures: usize,
        turns: usize,
        fault: ArmFault,
    },
}

/// Why an arm cannot follow a motion in one posture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum ArmFault {
    /// A joint's position.
    #[error("its joint `{joint}` would be at {q:.4} {at}, outside {lower:.4} to {upper:.4}")]
    Limit {
        joint: String,
        q: f64,
        lower: f64,
        upper: f64,
        at: Place,
    },
    /// Joints would turn fast for a slow hand.
    #[error(
        "it is singular {at}: the least singular value is {value:.4}, less than `arm.least_singular_value` = {least}"
    )]
    Singular { value: f64, least: f64, at: Place },
    /// The posture passes into none that is near.
    #[error("its joints would have to jump {at}")]
    Jump { at: Place },
    /// The arm's shapes and the table.
    #[error(
        "its link `{link}` would come to {gap_m:.4} m above the table {at}, less than `arm.clearance_m` = {least_m}"
    )]
    Table {
        link: String,
        /// Negative below the table.
        gap_m: f64,
        least_m: f64,
        at: Place,
    },
    /// The hand or the arm has another number of joints than is told.
    #[error("it cannot be followed: {0}")]
    Dof(#[from] WrongDof),
    /// Two links.
    #[error(
        "its link `{first}` may come to {gap_m:.4} m from link `{second}` {at}, less than `arm.clearance_m` = {least_m}"
    )]
    Collision {
        first: String,
        second: String,
        gap_m: f64,
        least_m: f64,
        at: Place,
    },
}

/// A place of what an arm has to follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    /// Of the motion to the grasp, seconds after its first step.
    Way { time_s: f64 },
    /// Of the lift, straight up from the grasp.
    Lift { height_m: f64 },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Way { time_s } => write!(f, "after {time_s:.3} s"),
            Self::Lift { height_m } => write!(f, "when lifted by {height_m:.3} m"),
        }
    }
}

fn numbers(numbers: &[f64; 3]) -> String {
    let [x, y, z] = numbers;
    format!("({x:.3}, {y:.3}, {z:.3})")
}
