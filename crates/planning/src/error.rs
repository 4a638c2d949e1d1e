//! Options with which nothing can be planned.

/// An option of a planner that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("option `{key}` cannot be used: {problem}")]
pub struct OptionError {
    /// The option's key, with those of the tables that hold it.
    pub key: &'static str,
    /// What is wrong.
    pub problem: String,
}

impl OptionError {
    pub(crate) fn new(key: &'static str, problem: impl Into<String>) -> Self {
        let problem = problem.into();
        Self { key, problem }
    }
}
