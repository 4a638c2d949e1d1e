//! Findings about a robot's description that can be read but is doubtful.

/// Something doubtful about a part of a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Its severity.
    pub severity: Severity,
    /// The part that it is about.
    pub part: Part,
    /// The problem with its numbers, as the words that follow the part's name in a sentence.
    pub problem: String,
    /// Advice for the user; empty if there is nothing to be done.
    pub advice: String,
}

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The description names it, and it does not exist or cannot be read: results that depend on it are
    /// unavailable.
    Missing,
    /// It is physically impossible: results that depend on it are wrong.
    Wrong,
    /// It may be intended, but is more often a mistake or a placeholder.
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
