//! Why steps do not form a motion.

use robot::{JointMismatch, WrongDof};

/// Why steps do not form a motion, or a motion has no spline.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// There are too few steps.
    #[error("{found} steps, expected at least {expected}")]
    Steps {
        /// Number of steps.
        found: usize,
        /// Fewest steps.
        expected: usize,
    },
    /// A number is missing, NaN or infinite.
    #[error("step {step} has a number that is missing or not finite")]
    Number {
        /// The step, from 0.
        step: usize,
    },
    /// Times do not increase.
    #[error("step {step} is at {time_s} s, not after {last_s} s")]
    Times {
        /// The step, from 0.
        step: usize,
        /// Its time in seconds.
        time_s: f64,
        /// The time of the step before, in seconds.
        last_s: f64,
    },
    /// The palm's turn has no rotation vector.
    #[error("the palm's turn before step {step} cannot be followed")]
    Turn {
        /// The step after the turn, from 0.
        step: usize,
    },
    /// The joints differ from the hand's.
    #[error("its joints are not those of the hand: `{}`", .0.joint())]
    Joints(#[from] JointMismatch),
    /// The number of joints differs.
    #[error(transparent)]
    Dof(#[from] WrongDof),
}
