//! Why a robot cannot make a motion.

use std::fmt;

use motion::MotionError;
use robot::WrongDof;

/// Why a robot cannot make a motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Infeasible {
    /// It is no continuous motion of the hand.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The motion has another number of joints than the hand.
    #[error(transparent)]
    Dof(#[from] WrongDof),
    /// A joint's position.
    #[error(
        "joint `{joint}` would be at {q:.4} after {time_s:.3} s, outside {lower:.4} to {upper:.4}"
    )]
    Limit {
        /// The joint.
        joint: String,
        /// Where it would be, in radians (meters if prismatic).
        q: f64,
        /// When, in seconds after the first step.
        time_s: f64,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
    },
    /// The hand's shapes and the table.
    #[error("link `{link}` would be {depth_m:.4} m below the table after {time_s:.3} s")]
    Table {
        /// The link.
        link: String,
        /// How deep, in meters.
        depth_m: f64,
        /// When, in seconds after the first step.
        time_s: f64,
    },
    /// The limits ask for too much time.
    #[error(
        "within its limits the motion takes {slower:.2} times as long, more than `limits.max_slowdown` = {most}"
    )]
    Slow {
        /// How many times as long.
        slower: f64,
        /// Most that is allowed.
        most: f64,
    },
    /// No posture of the arm is that of the way's end.
    #[error(
        "the arm cannot bring the palm to the grasp, {} m from its foot, at any of {turns} turns of the object",
        numbers(palm_in_base_m)
    )]
    Reach {
        /// Where it is with the object as it was screened, along the axes of the arm's foot.
        palm_in_base_m: [f64; 3],
        /// Turns of the object that were tried.
        turns: usize,
    },
    /// The arm comes to the grasp, but not all the way.
    #[error(
        "the arm cannot follow in any of {postures} postures at {turns} turns of the object; at best {fault}"
    )]
    Arm {
        /// Postures that were tried.
        postures: usize,
        /// Turns of the object that were tried.
        turns: usize,
        /// What keeps the best one from it.
        fault: ArmFault,
    },
}

/// Why an arm cannot follow a motion in one posture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmFault {
    /// A joint's position.
    #[error("its joint `{joint}` would be at {q:.4} {at}, outside {lower:.4} to {upper:.4}")]
    Limit {
        /// The joint.
        joint: String,
        /// Where it would be, in radians (meters if prismatic).
        q: f64,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
        /// Where.
        at: Place,
    },
    /// Joints would turn fast for a slow hand.
    #[error(
        "it is singular {at}: the least singular value is {value:.4}, less than `arm.least_singular_value` = {least}"
    )]
    Singular {
        /// The least singular value there.
        value: f64,
        /// The least that is allowed.
        least: f64,
        /// Where.
        at: Place,
    },
    /// The posture passes into none that is near.
    #[error("its joints would have to jump {at}")]
    Jump {
        /// Where.
        at: Place,
    },
    /// The arm's shapes and the table.
    #[error(
        "its link `{link}` would come to {gap_m:.4} m above the table {at}, less than `arm.clearance_m` = {least_m}"
    )]
    Table {
        /// The link.
        link: String,
        /// Negative below the table.
        gap_m: f64,
        /// The least that is allowed, in meters.
        least_m: f64,
        /// Where.
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
        /// One link.
        first: String,
        /// The other link.
        second: String,
        /// How far, in meters; negative if they overlap.
        gap_m: f64,
        /// The least that is allowed, in meters.
        least_m: f64,
        /// Where.
        at: Place,
    },
}

/// A place of what an arm has to follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// Of the motion to the grasp, seconds after its first step.
    Way {
        /// When, in seconds after the first step.
        time_s: f64,
    },
    /// Of the lift, straight up from the grasp.
    Lift {
        /// Height above the grasp, in meters.
        height_m: f64,
    },
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
