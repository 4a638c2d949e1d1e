//! Metadata of an output: its names, its code, the options it depends on.

use crate::code::Code;

/// Whether units of an output may run concurrently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Execution {
    /// As many at once as there are workers.
    Parallel,
    /// One after the other, and none after a failure, for units that move a simulated robot.
    OneByOne,
    /// As [`Execution::OneByOne`], for units whose making cannot be undone, as those that move a robot:
    /// never on another machine than that of the run, and never a second time on another.
    Physical,
}

/// The options of a stage that an output depends on, by their names in its table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionsUsed {
    /// All of them.
    All,
    /// These alone.
    Only(&'static [&'static str]),
    /// All but these.
    Except(&'static [&'static str]),
}

impl OptionsUsed {
    /// None of them: for an output that only shows others, such as a report.
    pub const NONE: Self = Self::Only(&[]);

    /// Whether an option is among them.
    pub(crate) fn includes(self, option: &str) -> bool {
        match self {
            Self::All => true,
            Self::Only(names) => names.contains(&option),
            Self::Except(names) => !names.contains(&option),
        }
    }

    /// The named options.
    pub(crate) fn named(self) -> &'static [&'static str] {
        match self {
            Self::All => &[],
            Self::Only(names) | Self::Except(names) => names,
        }
    }
}

/// The metadata of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputInfo {
    /// The artifact's name.
    pub artifact: &'static str,
    /// Name and version of its schema.
    pub schema: &'static str,
    /// Kind of item that one partition holds.
    pub partition: &'static str,
    /// Whether its units may run concurrently.
    pub execution: Execution,
    /// The sources it depends on.
    pub code: Code,
    /// The options it depends on.
    pub options: OptionsUsed,
}
