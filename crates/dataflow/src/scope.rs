//! The input partitions from which a stage lists its units.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::{name::PartitionKey, outcome::Labels, record::RecordOutcome};

/// The input partitions from which a stage lists its units.
#[derive(Debug, Clone, Default)]
pub struct Scope {
    partitions: BTreeMap<String, Vec<Partition>>,
}

impl Scope {
    /// Returns the scope that holds these partitions by input name or own output's artifact.
    pub fn new(partitions: BTreeMap<String, Vec<Partition>>) -> Self {
        Self { partitions }
    }

    /// Returns the names of the inputs, and of the outputs of this stage that are made earlier.
    pub fn inputs(&self) -> impl Iterator<Item = &str> {
        self.partitions.keys().map(String::as_str)
    }

    /// Returns the partitions of an input, or of an output of this stage that is made earlier,
    /// ordered by key.
    pub fn partitions(&self, name: &str) -> &[Partition] {
        self.partitions.get(name).map_or(&[], Vec::as_slice)
    }
}

/// One partition of an artifact, as far as planning needs it.
#[derive(Debug, Clone)]
pub struct Partition {
    /// The partition's key, e.g. the sequence's name.
    pub key: PartitionKey,
    labels: LabelsOf,
    /// Set when a label that may still change is read.
    asked: Option<Arc<AtomicBool>>,
}

/// Where a partition's labels are.
#[derive(Debug, Clone)]
enum LabelsOf {
    Own(Labels),
    /// In the made result, shared because there may be many.
    Made(Arc<RecordOutcome>),
}

impl Partition {
    /// Returns the partition of this key with these labels.
    pub fn new(key: PartitionKey, labels: Labels) -> Self {
        Self {
            key,
            labels: LabelsOf::Own(labels),
            asked: None,
        }
    }

    /// Returns a partition that is made.
    pub(crate) fn made(key: &PartitionKey, outcome: &Arc<RecordOutcome>) -> Self {
        Self {
            key: key.clone(),
            labels: LabelsOf::Made(Arc::clone(outcome)),
            asked: None,
        }
    }

    /// Returns a partition whose labels may still change; `asked` is set if one is read.
    pub(crate) fn uncertain(key: &PartitionKey, labels: Labels, asked: &Arc<AtomicBool>) -> Self {
        Self {
            key: key.clone(),
            labels: LabelsOf::Own(labels),
            asked: Some(Arc::clone(asked)),
        }
    }

    /// Returns a label, e.g. `object`.
    pub fn label(&self, name: &str) -> Option<&str> {
        if let Some(asked) = &self.asked {
            asked.store(true, Ordering::Relaxed);
        }
        self.labels().get(name).map(String::as_str)
    }

    /// Returns the labels; `None` if they may still change.
    pub(crate) fn certain_labels(&self) -> Option<&Labels> {
        self.asked.is_none().then(|| self.labels())
    }

    fn labels(&self) -> &Labels {
        match &self.labels {
            LabelsOf::Own(labels) => labels,
            LabelsOf::Made(outcome) => outcome.labels(),
        }
    }
}
