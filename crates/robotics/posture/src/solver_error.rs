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
        /// Number of such joints.
        found: usize,
        /// Largest number allowed.
        most: usize,
    },
    /// A target names a point that was not attached.
    #[error("no point {point}, {found} are attached")]
    NoPoint {
        /// The point's number.
        point: usize,
        /// Number of attached points.
        found: usize,
    },
    /// A target names a vector without which the hand was compiled.
    #[error("no vector {vector}, the hand was compiled with {found}")]
    NoVector {
        /// The vector's number.
        vector: usize,
        /// Number of vectors.
        found: usize,
    },
    /// A list has the wrong length.
    #[error("{found} {what}, expected {expected}")]
    WrongLength {
        /// Name of the items in the list.
        what: &'static str,
        /// Length found.
        found: usize,
        /// Length expected.
        expected: usize,
    },
    /// A number is NaN or infinite, or a weight is negative.
    #[error("{what} is not a usable number")]
    BadNumber {
        /// Name of the number.
        what: String,
    },
}
