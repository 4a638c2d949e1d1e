//! The outcome of one partition.

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

/// The outcome of one partition.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<M = Figures> {
    /// The files in [`Context::folder`](crate::Context::folder) are the artifact.
    Made(Made<M>),
    /// The item cannot be used; counted, listed, and the run ends with exit code 3.
    Skipped {
        /// Why, as one sentence without a final period.
        reason: String,
    },
    /// The configuration excludes this item; listed, but not a fault.
    Filtered {
        /// Why, as one sentence without a final period.
        reason: String,
    },
}

/// Labels and metrics of a partition, beside its files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Made<M = Figures> {
    /// Facts by which later stages choose partitions, as predicted by
    /// [`Output::labels`](crate::Output::labels).
    pub labels: Labels,
    /// Metrics for the output's line and for comparing runs.
    pub metrics: M,
}

impl<M> Outcome<M> {
    /// Returns a made outcome with its labels and metrics.
    pub fn made(labels: Labels, metrics: M) -> Self {
        Self::Made(Made { labels, metrics })
    }

    /// Returns a skipped outcome with its reason.
    pub fn skipped(reason: impl Into<String>) -> Self {
        Self::Skipped {
            reason: reason.into(),
        }
    }

    /// Returns a filtered outcome with its reason.
    pub fn filtered(reason: impl Into<String>) -> Self {
        Self::Filtered {
            reason: reason.into(),
        }
    }
}

impl<M: Metrics> Outcome<M> {
    /// Returns the outcome with its metrics as they are stored.
    pub fn stored(self) -> Outcome {
        match self {
            Self::Made(made) => Outcome::made(made.labels, made.metrics.figures()),
            Self::Skipped { reason } => Outcome::Skipped { reason },
            Self::Filtered { reason } => Outcome::Filtered { reason },
        }
    }
}
