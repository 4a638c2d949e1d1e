//! Why a table violates its schema.

use arrow_schema::ArrowError;
use motion::MotionError;
use nalgebra::{Unit, Vector3};
use spatial::InvalidPose;

/// Why a table violates its schema.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SchemaError {
    /// The table was written by another version.
    #[error("table has schema `{found}`, expected `{expected}`")]
    Version {
        /// The version of this program.
        expected: String,
        /// The version in the file.
        found: String,
    },
    /// A column is missing or has another type.
    #[error("column `{column}` is missing or not of type {expected}")]
    Column {
        /// The column's name.
        column: String,
        /// The expected type.
        expected: &'static str,
    },
    /// A cell, or an entry of the list in it, is null.
    #[error("table `{table}` has a null in column `{column}`, row {row}")]
    Null {
        /// The table's schema.
        table: String,
        /// The column's name.
        column: String,
        /// The row.
        row: usize,
    },
    /// A number is NaN or infinite.
    #[error("column `{column}` holds a number that is not finite in row {row}")]
    NotFinite {
        /// The column's name.
        column: String,
        /// The row.
        row: usize,
    },
    /// There are too few or too many rows.
    #[error("table has {found} rows, expected {expected}")]
    Rows {
        /// Expected number of rows, in words.
        expected: &'static str,
        /// Rows found.
        found: usize,
    },
    /// A value breaks the artifact's own rules.
    #[error("column `{column}`: {message}")]
    Invalid {
        /// The column's name.
        column: String,
        /// The broken rule.
        message: String,
    },
    /// A value is not a valid pose.
    #[error("column `{column}` does not hold a pose")]
    Pose {
        /// The column's name.
        column: String,
        /// Why.
        source: InvalidPose,
    },
    /// The steps of a row, or of a table's rows, are not a motion.
    #[error("`{name}` is not a motion")]
    Motion {
        /// The candidate, or the trajectory's sequence.
        name: String,
        /// The cause.
        source: MotionError,
    },
    /// The columns do not make a batch.
    #[error("columns do not fit together")]
    Arrow(#[from] ArrowError),
}

impl SchemaError {
    /// Returns the error of a value that breaks the artifact's own rules.
    pub(crate) fn invalid(column: &str, message: String) -> Self {
        Self::Invalid {
            column: column.to_owned(),
            message,
        }
    }

    /// Returns the direction that a column holds.
    pub(crate) fn check_direction(
        column: &str,
        vector: [f64; 3],
    ) -> Result<Unit<Vector3<f64>>, Self> {
        /// Directions are written as unit vectors.
        const MIN_NORM: f64 = 0.5;
        Unit::try_new(Vector3::from(vector), MIN_NORM)
            .ok_or_else(|| Self::invalid(column, format!("{vector:?} is not a direction")))
    }

    /// Checks the length of a column's list, e.g. of joint positions.
    pub(crate) fn check_length<T>(
        column: &str,
        what: &str,
        list: &[T],
        expected: usize,
    ) -> Result<(), Self> {
        match list.len() {
            found if found == expected => Ok(()),
            found => Err(Self::invalid(
                column,
                format!("{found} {what}, expected {expected}"),
            )),
        }
    }
}
