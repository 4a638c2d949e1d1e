//! Why a motion is infeasible for a robot.

use std::fmt;

use motion::MotionError;
use robot::WrongDof;

/// Why a motion is infeasible for a robot.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Infeasible {
    /// The steps do not form a continuous motion of the hand.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The motion's number of joints differs from the hand's.
    #[error(transparent)]
    Dof(#[from] WrongDof),
    /// A joint position exceeds its limits.
    #[error(
        "joint `{joint}` would be at {q:.4} after {time_s:.3} s, outside {lower:.4} to {upper:.4}"
    )]
    Limit {
        /// The joint.
        joint: String,
        /// Its position, in radians (meters if prismatic).
        q: f64,
        /// Time, in seconds after the first step.
        time_s: f64,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
    },
    /// The hand would collide with the table.
    #[error("link `{link}` would be {depth_m:.4} m below the table after {time_s:.3} s")]
    Table {
        /// The link.
        link: String,
        /// Penetration, in meters.
        depth_m: f64,
        /// Time, in seconds after the first step.
        time_s: f64,
    },
    /// The limits require too great a slowdown.
    #[error("needs a slowdown of {slower:.2}, more than `limits.max_slowdown` = {max}")]
    Slow {
        /// Required slowdown factor.
        slower: f64,
        /// Largest allowed factor.
        max: f64,
    },
    /// The arm cannot reach the grasp: inverse kinematics has no solution.
    #[error(
        "grasp unreachable: no inverse kinematics solution for the palm at {} m (base frame), at any of \
         {turns} object yaws",
        numbers(palm_in_base_m)
    )]
    Reach {
        /// Palm position with the object as screened, along the axes of the arm's base.
        palm_in_base_m: [f64; 3],
        /// Number of object rotations tried.
        turns: usize,
    },
    /// The arm cannot follow between two points where it can.
    #[error("the arm cannot follow: {0}")]
    ArmBetween(#[from] ArmFault),
    /// The arm reaches the grasp, but not along the whole path.
    #[error(
        "no feasible arm trajectory: {postures} postures at {turns} yaws tried; the best fails because \
         {fault}"
    )]
    Arm {
        /// Number of postures tried.
        postures: usize,
        /// Number of object rotations tried.
        turns: usize,
        /// The failure of the best posture.
        fault: ArmFault,
    },
}

/// Why an arm cannot follow a motion in one posture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmFault {
    /// A joint position exceeds its limits.
    #[error("its joint `{joint}` would be at {q:.4} {at}, outside {lower:.4} to {upper:.4}")]
    Limit {
        /// The joint.
        joint: String,
        /// Its position, in radians (meters if prismatic).
        q: f64,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
        /// Point on the path.
        at: PathPoint,
    },
    /// The arm is close to a singularity: joints would turn fast for a slow hand.
    #[error(
        "it is singular {at}: the least singular value is {value:.4}, less than `arm.min_singular_value` = {least}"
    )]
    Singular {
        /// The smallest singular value there.
        value: f64,
        /// The least allowed value.
        least: f64,
        /// Point on the path.
        at: PathPoint,
    },
    /// Inverse kinematics has no continuous solution.
    #[error("its joints would have to jump {at}")]
    Jump {
        /// Point on the path.
        at: PathPoint,
    },
    /// A link would come too close to the table.
    #[error(
        "its link `{link}` would come to {gap_m:.4} m above the table {at}, less than `arm.clearance_m` = {least_m}"
    )]
    Table {
        /// The link.
        link: String,
        /// Clearance, in meters; negative below the table.
        gap_m: f64,
        /// The least allowed clearance, in meters.
        least_m: f64,
        /// Point on the path.
        at: PathPoint,
    },
    /// The number of joint positions differs from the robot's joints.
    #[error("it cannot be followed: {0}")]
    Dof(#[from] WrongDof),
    /// Two links would come too close.
    #[error(
        "its link `{first}` may come to {gap_m:.4} m from link `{second}` {at}, less than `arm.clearance_m` = {least_m}"
    )]
    Collision {
        /// One link.
        first: String,
        /// The other link.
        second: String,
        /// Clearance, in meters; negative if they overlap.
        gap_m: f64,
        /// The least allowed clearance, in meters.
        least_m: f64,
        /// Point on the path.
        at: PathPoint,
    },
}

/// A point on the path of an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathPoint {
    /// On the reach.
    Reach {
        /// Time, in seconds after the first step.
        time_s: f64,
    },
    /// On the lift, straight up from the grasp.
    Lift {
        /// Height above the grasp, in meters.
        height_m: f64,
    },
}

impl fmt::Display for PathPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reach { time_s } => write!(f, "after {time_s:.3} s"),
            Self::Lift { height_m } => write!(f, "when lifted by {height_m:.3} m"),
        }
    }
}

fn numbers(numbers: &[f64; 3]) -> String {
    let [x, y, z] = numbers;
    format!("({x:.3}, {y:.3}, {z:.3})")
}
