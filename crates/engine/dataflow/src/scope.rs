//! The input partitions from which a stage lists its units.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use serde::{Deserialize, Serialize};

use crate::{input_error::InputError, name::PartitionKey, outcome::Labels, record::RecordOutcome};

/// The input partitions from which a stage lists its units.
#[derive(Debug, Clone, Default)]
pub struct Scope {
    partitions: BTreeMap<String, Vec<Partition>>,
    left_out: BTreeMap<String, Vec<SkippedItem>>,
    run: RunFacts,
}

/// A partition that an input lacks, because it was skipped or filtered.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkippedItem {
    /// Its key.
    pub key: String,
    /// Whether it could not be used, rather than excluded by the options.
    pub is_fault: bool,
    /// Reason that its stage gave.
    pub reason: String,
}

/// Facts of a pipeline that its stages may report.
///
/// A unit that depends on any of it lists it among its [`facts`](crate::Unit::facts).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFacts {
    /// The pipeline's name.
    pub pipeline: String,
    /// Its seed.
    pub seed: u64,
    /// The profile, if one was selected.
    pub profile: Option<String>,
    /// Values given beside the file, as `stage.key=value`; of one that names a file or folder outside the
    /// lake, the value is `…`: it counts by content.
    pub overrides: Vec<String>,
    /// The output to which each input of the stage is wired, as `stage.artifact`.
    pub wired: BTreeMap<String, String>,
    /// The kind of every stage.
    pub kinds: BTreeMap<String, String>,
    /// The effective options of every stage, as fingerprints hold them.
    pub options: BTreeMap<String, serde_json::Value>,
    /// Digest of the code of every stage's outputs, by stage and artifact.
    pub code: BTreeMap<String, String>,
}

impl Scope {
    /// Returns the scope that holds these partitions by input name or own output's artifact.
    pub fn new(partitions: BTreeMap<String, Vec<Partition>>) -> Self {
        Self {
            partitions,
            ..Self::default()
        }
    }

    /// Adds the partitions that inputs lack.
    #[must_use]
    pub fn with_left_out(self, left_out: BTreeMap<String, Vec<SkippedItem>>) -> Self {
        Self { left_out, ..self }
    }

    /// Adds facts of the pipeline.
    #[must_use]
    pub fn with_run(self, run: RunFacts) -> Self {
        Self { run, ..self }
    }

    /// Returns the partitions of an input that were skipped or filtered, ordered by key.
    pub fn left_out(&self, name: &str) -> &[SkippedItem] {
        self.left_out.get(name).map_or(&[], Vec::as_slice)
    }

    /// Returns facts of the pipeline.
    pub fn run(&self) -> &RunFacts {
        &self.run
    }

    /// Returns the names of the inputs, and of the outputs of this stage that are made earlier.
    pub fn inputs(&self) -> impl Iterator<Item = &str> {
        self.partitions.keys().map(String::as_str)
    }

    /// Returns the partitions of an input without which there is nothing `to_do`, e.g. `to refine`.
    ///
    /// # Errors
    ///
    /// Fails if there is none.
    pub fn non_empty(
        &self,
        input: &'static str,
        to_do: &'static str,
    ) -> Result<&[Partition], InputError> {
        match self.partitions(input) {
            [] => Err(InputError::Empty { input, to_do }),
            partitions => Ok(partitions),
        }
    }

    /// Returns the partitions of an input, each of one item such as an `object`, that an option names, all of
    /// them if it names none.
    ///
    /// # Errors
    ///
    /// Fails if the option names a partition that the input does not have.
    pub fn chosen(
        &self,
        input: &'static str,
        item: &'static str,
        names: &[String],
    ) -> Result<Vec<&Partition>, InputError> {
        let all = self.partitions(input);
        if let Some(name) = names
            .iter()
            .find(|name| !all.iter().any(|known| known.key == ***name))
        {
            let known = all.iter().map(|known| known.key.as_str());
            return Err(InputError::unknown(input, item, name, known));
        }
        let is_chosen =
            |known: &&Partition| names.is_empty() || names.iter().any(|name| known.key == **name);
        Ok(all.iter().filter(is_chosen).collect())
    }

    /// Returns the keys of an input's partitions by a label's values: of those that an option names, of all if it
    /// names none. Partitions without the label are left out.
    ///
    /// # Errors
    ///
    /// Fails if the option names a value that no partition has.
    pub fn chosen_by_label(
        &self,
        input: &'static str,
        label: &'static str,
        names: &[String],
    ) -> Result<BTreeMap<&str, Vec<&PartitionKey>>, InputError> {
        let mut by_label: BTreeMap<&str, Vec<&PartitionKey>> = BTreeMap::new();
        for partition in self.partitions(input) {
            if let Some(value) = partition.label(label) {
                by_label.entry(value).or_default().push(&partition.key);
            }
        }
        let unknown = |name: &&String| !by_label.contains_key(name.as_str());
        if let Some(name) = names.iter().find(unknown) {
            return Err(InputError::unknown(
                input,
                label,
                name,
                by_label.into_keys(),
            ));
        }
        by_label.retain(|value, _| names.is_empty() || names.iter().any(|name| name == value));
        Ok(by_label)
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

/// Storage of a partition's labels.
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
