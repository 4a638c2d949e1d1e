//! The outcome of all partitions of an output: metrics and a line.

use std::fmt::Display;

use crate::{
    metrics::{MetricValues, Metrics, MissingMetric},
    record::RecordOutcome,
};

/// The outcome of all units of one output, for its line in the report.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary<M = MetricValues> {
    /// Partitions made or taken from the lake.
    pub n_made: usize,
    /// Items skipped as unusable.
    pub n_skipped: usize,
    /// Items left out by configuration.
    pub n_filtered: usize,
    /// The metrics, aggregated over the partitions.
    pub metrics: M,
}

impl<M> Summary<M> {
    /// Number of items, whatever their outcome.
    pub fn item_count(&self) -> usize {
        self.n_made + self.n_skipped + self.n_filtered
    }
}

impl<M: Metrics> Summary<M> {
    /// Summarizes partitions that were all made.
    pub fn made(partitions: &[M]) -> Self {
        Self {
            n_made: partitions.len(),
            n_skipped: 0,
            n_filtered: 0,
            metrics: M::aggregate(partitions),
        }
    }

    /// Summarizes results, in the order of their partitions.
    ///
    /// # Errors
    ///
    /// Fails if a stored result lacks a required metric.
    pub(crate) fn of(outcomes: &[&RecordOutcome]) -> Result<Self, MissingMetric> {
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

    /// Returns the summary with its metrics as they are stored.
    pub(crate) fn stored(&self) -> Summary {
        Summary {
            n_made: self.n_made,
            n_skipped: self.n_skipped,
            n_filtered: self.n_filtered,
            metrics: self.metrics.metric_values(),
        }
    }
}

/// The line of an output in `run`: its summary in the user's terms, e.g.
/// `24 recordings → 23 demonstrations`.
pub type Line<M> = fn(&Summary<M>) -> String;

/// Returns a count with its noun, which is in the singular for one.
///
/// ```
/// assert_eq!(dataflow::counted(1, "trajectory"), "1 trajectory");
/// assert_eq!(dataflow::counted(12, "trajectory"), "12 trajectories");
/// assert_eq!(dataflow::counted(0.0, "sample"), "0 samples");
/// ```
#[must_use]
pub fn counted(n: impl Display, noun: &str) -> String {
    let n = n.to_string();
    match noun.strip_suffix('y') {
        _ if n == "1" => format!("1 {noun}"),
        Some(stem) => format!("{n} {stem}ies"),
        None => format!("{n} {noun}s"),
    }
}
