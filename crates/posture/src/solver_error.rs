//! Why the solver cannot be used.

/// Why the solver cannot be used on a hand or a task.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolverError {
    /// A point is attached to a link that does not exist.
    #[error("no link {link}")]
    NoLink {
        /// The link's number.
        link: usize,
    },
    /// More joints depend on one another than the solver was made for.
    #[error("{found} joints of one branch depend on one another, at most {most} can")]
    TooManyJoints {
        /// How many do.
        found: usize,
        /// How many may.
        most: usize,
    },
    /// A target names a point that was not attached.
    #[error("no point {point}, {found} are attached")]
    NoPoint {
        /// The point's number.
        point: usize,
        /// How many there are.
        found: usize,
    },
    /// A list has the wrong length.
    #[error("{found} {what}, expected {expected}")]
    WrongLength {
        /// What is listed.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A number is NaN or infinite, or a weight is negative.
    #[error("{what} is not a usable number")]
    BadNumber {
        /// Which number.
        what: String,
    },
}
