//! Differences in the results of two runs: metrics and partitions, by output.

use dataflow::{NodeRecord, PartitionKey, RunRecord};
use serde::Serialize;

use super::{units::Pair, values::keys};

/// A differing metric, aggregated over the partitions of an output; `null` if there was none.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct MetricChange {
    pub(super) metric: String,
    pub(super) old: Option<f64>,
    pub(super) new: Option<f64>,
}

/// An output that differs.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct OutputChange {
    pub(super) output: String,
    pub(super) added: Vec<PartitionKey>,
    pub(super) removed: Vec<PartitionKey>,
    /// Partitions whose bytes or labels differ.
    pub(super) changed: Vec<PartitionKey>,
    pub(super) metrics: Vec<MetricChange>,
}

/// Lists the differing outputs that both runs visited.
pub(super) fn compare(old: &RunRecord, new: &RunRecord, pairs: &[Pair]) -> Vec<OutputChange> {
    let mut outputs = Vec::new();
    for after in &new.nodes {
        let Some(before) = old.nodes.iter().find(|node| node.node == after.node) else {
            continue;
        };
        let mut output = OutputChange {
            output: after.node.to_string(),
            added: Vec::new(),
            removed: Vec::new(),
            changed: Vec::new(),
            metrics: metrics(before, after),
        };
        if let Some(pair) = pairs.iter().find(|pair| pair.node == after.node) {
            let (old, new) = (pair.old.partitions(), pair.new.partitions());
            let content = |key: &PartitionKey| (pair.old.content(key), pair.new.content(key));
            let differs = |key: &&PartitionKey| matches!(content(key), (old, new) if old != new);
            output.added = new.difference(&old).copied().cloned().collect();
            output.removed = old.difference(&new).copied().cloned().collect();
            let both = old.intersection(&new).copied();
            output.changed = both.filter(differs).cloned().collect();
        }
        let lists = [&output.added, &output.removed, &output.changed];
        if !output.metrics.is_empty() || lists.iter().any(|list| !list.is_empty()) {
            outputs.push(output);
        }
    }
    outputs
}

/// Relative difference below which two sums are equal: one of the computed numbers, one of their
/// decimal forms.
const ROUNDING: f64 = 1e-12;

fn metrics(old: &NodeRecord, new: &NodeRecord) -> Vec<MetricChange> {
    let mut changes = Vec::new();
    let mut compare = |metric: &str, old: Option<f64>, new: Option<f64>| {
        let is_rounding = old
            .zip(new)
            .is_some_and(|(old, new)| (old - new).abs() <= ROUNDING * old.abs().max(new.abs()));
        if old != new && !is_rounding {
            let metric = metric.to_owned();
            changes.push(MetricChange { metric, old, new });
        }
    };
    #[expect(clippy::cast_precision_loss, reason = "counts of items are small")]
    let count = |n: usize| Some(n as f64);
    compare("skipped", count(old.n_skipped), count(new.n_skipped));
    compare("filtered", count(old.n_filtered), count(new.n_filtered));
    for name in keys(&old.metrics, &new.metrics) {
        let value = |node: &NodeRecord| node.metrics.get(name).copied();
        compare(name, value(old), value(new));
    }
    changes
}

/// Outputs that only the first of two runs visited.
pub(super) fn only_in(one: &RunRecord, other: &RunRecord) -> Vec<String> {
    let nodes = one.nodes.iter().map(|node| &node.node);
    let only = nodes.filter(|name| !other.nodes.iter().any(|node| node.node == **name));
    only.map(ToString::to_string).collect()
}
