//! The outcome of one partition.

use std::collections::BTreeMap;

use crate::metrics::{MetricValues, Metrics};

/// Facts by which later stages choose partitions, e.g. `object = 003_cracker_box`.
pub type Labels = BTreeMap<String, String>;

/// The outcome of one partition.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<M = MetricValues> {
    /// The files in [`Context::folder`](crate::Context::folder) are the artifact; its labels are
    /// those of its [`Unit`](crate::Unit).
    Made(M),
    /// As made, with labels that are known only from the data.
    Labeled(M, Labels),
    /// As made, but for this run alone: the next one finds nothing stored and makes it again, as after a dry
    /// run.
    Provisional(M),
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

impl<M> Outcome<M> {
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
            Self::Made(metrics) => Outcome::Made(metrics.metric_values()),
            Self::Labeled(metrics, labels) => Outcome::Labeled(metrics.metric_values(), labels),
            Self::Provisional(metrics) => Outcome::Provisional(metrics.metric_values()),
            Self::Skipped { reason } => Outcome::Skipped { reason },
            Self::Filtered { reason } => Outcome::Filtered { reason },
        }
    }
}
