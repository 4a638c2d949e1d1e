//! What became of one partition.

use std::collections::BTreeMap;

use crate::metrics::{Figures, Metrics};

/// Facts by which later stages choose partitions, e.g. `object = 003_cracker_box`.
pub type Labels = BTreeMap<String, String>;

/// Returns labels with these names and values.
pub fn labels<const N: usize>(labels: [(&str, &str); N]) -> Labels {
    labels
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .into()
}

/// What became of one partition.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<M = Figures> {
    /// The files in [`Context::folder`](crate::Context::folder) are the artifact.
    Made(Made<M>),
    /// The item cannot be used; counted, listed, and the run ends with exit code 3.
    Skipped {
        /// Why, as one sentence without a final period.
        reason: String,
    },
    /// The configuration asks to leave this item out; listed, and no fault.
    Filtered {
        /// Why, as one sentence without a final period.
        reason: String,
    },
}

/// What is said about a partition beside its files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Made<M = Figures> {
    /// Facts by which later stages choose partitions, as
    /// [`Output::labels`](crate::Output::labels) foretells them.
    pub labels: Labels,
    /// Figures for the output's line and for comparing runs.
    pub metrics: M,
}

impl<M> Outcome<M> {
    /// Returns that the files are the artifact, and what is said about it.
    pub fn made(labels: Labels, metrics: M) -> Self {
        Self::Made(Made { labels, metrics })
    }

    /// Returns that an item cannot be used, and why.
    pub fn skipped(reason: impl Into<String>) -> Self {
        Self::Skipped {
            reason: reason.into(),
        }
    }

    /// Returns that the configuration leaves an item out, and why.
    pub fn filtered(reason: impl Into<String>) -> Self {
        Self::Filtered {
            reason: reason.into(),
        }
    }
}

impl<M: Metrics> Outcome<M> {
    /// Returns the outcome with its figures as they are stored.
    pub fn stored(self) -> Outcome {
        match self {
            Self::Made(made) => Outcome::made(made.labels, made.metrics.figures()),
            Self::Skipped { reason } => Outcome::Skipped { reason },
            Self::Filtered { reason } => Outcome::Filtered { reason },
        }
    }
}
