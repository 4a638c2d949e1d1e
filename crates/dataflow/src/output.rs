//! What is said of an output: its names, its code, the options that decide it.

use crate::code::Code;

/// Whether units of an output may be made at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Execution {
    /// As many at once as there are workers.
    Parallel,
    /// One after the other, and none after a failure: units that move a robot.
    OneByOne,
}

/// The options of a stage that decide an output, by their names in its table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Options {
    /// All of them.
    All,
    /// These alone.
    Only(&'static [&'static str]),
    /// All but these.
    Except(&'static [&'static str]),
}

impl Options {
    /// None of them: what an output goes by that shows others, as a report does.
    pub const NONE: Self = Self::Only(&[]);

    /// Whether an option is one of them.
    pub(crate) fn contain(self, option: &str) -> bool {
        match self {
            Self::All => true,
            Self::Only(names) => names.contains(&option),
            Self::Except(names) => !names.contains(&option),
        }
    }

    /// The options that are named.
    pub(crate) fn named(self) -> &'static [&'static str] {
        match self {
            Self::All => &[],
            Self::Only(names) | Self::Except(names) => names,
        }
    }
}

/// An output, for whoever goes through the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputInfo {
    /// The artifact's name.
    pub artifact: &'static str,
    /// Name and version of its schema.
    pub schema: &'static str,
    /// What one partition stands for.
    pub partition: &'static str,
    /// Whether its units may be made at the same time.
    pub execution: Execution,
    /// The sources that decide it.
    pub code: Code,
    /// The options that decide it.
    pub options: Options,
}
