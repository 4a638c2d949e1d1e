//! What is doubtful in a robot's description although it can be read.

/// Something doubtful about a part of a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How much it matters.
    pub severity: Severity,
    /// What it is about.
    pub part: Part,
    /// What is the case, with its numbers: what follows the part's name in a sentence.
    pub problem: String,
    /// What to do about it; empty if there is nothing to be done.
    pub advice: String,
}

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The description names it, and it is not there or cannot be read: nothing that rests on it can
    /// be had.
    Missing,
    /// No real robot is so: results that rest on it are wrong.
    Wrong,
    /// It may be meant, and is more often a mistake or a placeholder.
    Doubtful,
    /// Worth knowing.
    Note,
}

/// A part of a robot, by its name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The whole of it.
    Robot,
    /// A link.
    Link(String),
    /// A joint.
    Joint(String),
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Robot => f.write_str("robot"),
            Self::Link(name) => write!(f, "link `{name}`"),
            Self::Joint(name) => write!(f, "joint `{name}`"),
        }
    }
}
