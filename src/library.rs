//! Answers for programs that hold this one as a library: values and errors, nothing printed.

use std::{error::Error, fmt, path::Path};

use datafusion::arrow::array::RecordBatch;

use crate::{commands, outcome::CommandError, report::chain};

/// A refused question: what is wrong, and what to do.
#[derive(Debug)]
pub struct Refusal {
    /// What is wrong, and where.
    pub message: String,
    /// What to do, if it is known.
    pub hint: Option<String>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Error for Refusal {}

impl From<CommandError> for Refusal {
    fn from(err: CommandError) -> Self {
        match err {
            CommandError::File(err) => Self {
                message: err.to_string(),
                hint: err.problems.into_iter().find_map(|problem| problem.hint),
            },
            CommandError::Usage { message, hint } => Self { message, hint },
            CommandError::Failed { error, hint } => Self {
                message: chain(&error),
                hint,
            },
        }
    }
}

/// Answers a question in SQL over the tables of the lake in this folder, as `pipeline query` does: of the newest run
/// that made each table, or of the run of this name.
///
/// # Errors
///
/// Fails if there is no lake, run or table of such a name, if a table is damaged, and at what is no question in SQL.
pub fn query(lake: &Path, sql: &str, run: Option<&str>) -> Result<RecordBatch, Refusal> {
    Ok(commands::rows(lake, sql, run)?)
}
