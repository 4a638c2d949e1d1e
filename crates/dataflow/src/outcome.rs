//! What became of a partition, and of all partitions of an output.

use std::collections::BTreeMap;

use crate::metrics::{Figures, Metrics, MissingFigure};
use crate::store::RecordOutcome;

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

/// What became of all units of one output, for its line in the report.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary<M = Figures> {
    /// Partitions made or taken from the lake.
    pub n_made: usize,
    /// Items skipped as unusable.
    pub n_skipped: usize,
    /// Items left out by configuration.
    pub n_filtered: usize,
    /// The figures, gathered over the partitions.
    pub metrics: M,
}

impl<M> Summary<M> {
    /// Number of items, whatever became of them.
    pub fn n_items(&self) -> usize {
        self.n_made + self.n_skipped + self.n_filtered
    }
}

impl<M: Metrics> Summary<M> {
    /// Sums up partitions that all were made.
    pub fn made(partitions: &[M]) -> Self {
        Self {
            n_made: partitions.len(),
            n_skipped: 0,
            n_filtered: 0,
            metrics: M::gather(partitions),
        }
    }

    /// Sums up results, in the order of their partitions.
    ///
    /// # Errors
    ///
    /// Fails if a stored result lacks a figure that every partition has.
    pub(crate) fn of(outcomes: &[&RecordOutcome]) -> Result<Self, MissingFigure> {
        let (mut n_skipped, mut n_filtered) = (0, 0);
        let mut partitions = Vec::with_capacity(outcomes.len());
        for outcome in outcomes {
            match outcome {
                RecordOutcome::Made { metrics, .. } => partitions.push(M::read(metrics)?),
                RecordOutcome::Skipped { .. } => n_skipped += 1,
                RecordOutcome::Filtered { .. } => n_filtered += 1,
            }
        }
        Ok(Self {
            n_skipped,
            n_filtered,
            ..Self::made(&partitions)
        })
    }

    /// Returns the summary with its figures as they are stored.
    pub(crate) fn stored(&self) -> Summary {
        Summary {
            n_made: self.n_made,
            n_skipped: self.n_skipped,
            n_filtered: self.n_filtered,
            metrics: self.metrics.figures(),
        }
    }
}
