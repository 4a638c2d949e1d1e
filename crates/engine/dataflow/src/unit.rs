//! Units of work: one partition of one output of one stage.

use std::collections::BTreeMap;

use crate::{
    canonical_form::Form,
    name::{ArtifactName, InvalidName, PartitionKey},
    outcome::Labels,
    scope::{Partition, Scope},
    source_file::SourceFile,
};

/// One partition to make and what it reads, as its stage lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unit<A = String, K = String> {
    /// The partition's key, e.g. the sequence's or the object's name.
    pub partition: K,
    /// Keys of the partitions read, by input name (or by an earlier output of the same stage).
    pub reads: BTreeMap<A, Vec<K>>,
    /// Names of the files that it reads from an input's partitions; all files if none are named. A
    /// change of other files does not rerun it.
    pub parts: BTreeMap<String, Vec<String>>,
    /// Files outside the lake that it reads.
    pub files: Vec<SourceFile>,
    /// Canonical forms of these files, by name; other files count by every byte.
    pub forms: BTreeMap<String, Form>,
    /// Facts found while it was listed that [`crate::Output::make`] depends on, by name. A changed
    /// fact reruns the unit, unlike an option that only selects units.
    pub facts: BTreeMap<String, String>,
    /// Facts by which later stages choose partitions, if it is made; `None` if they are known only
    /// afterwards, or an input that is not made yet decides them.
    pub labels: Option<Labels>,
}

/// A unit as the engine knows it, with parsed names.
pub(crate) type ListedUnit = Unit<ArtifactName, PartitionKey>;

impl Unit {
    /// Returns a unit that reads nothing yet, and has no labels.
    pub fn new(partition: impl Into<String>) -> Self {
        Self {
            partition: partition.into(),
            reads: BTreeMap::new(),
            parts: BTreeMap::new(),
            files: Vec::new(),
            forms: BTreeMap::new(),
            facts: BTreeMap::new(),
            labels: Some(Labels::new()),
        }
    }

    /// Adds partitions of an input.
    #[must_use]
    pub fn reading<K: Into<String>>(
        mut self,
        input: &str,
        keys: impl IntoIterator<Item = K>,
    ) -> Self {
        self.reads
            .entry(input.to_owned())
            .or_default()
            .extend(keys.into_iter().map(Into::into));
        self
    }

    /// Adds the partition of an input that has this unit's key, if there is one.
    #[must_use]
    pub fn reading_own(self, input: &str, scope: &Scope) -> Self {
        let mut partitions = scope.partitions(input).iter();
        let own = partitions.find(|one| one.key == *self.partition);
        self.reading(input, own.map(|one| &one.key))
    }

    /// Restricts the files read from an input's partitions to these.
    #[must_use]
    pub fn only_files<K: Into<String>>(
        mut self,
        input: &str,
        names: impl IntoIterator<Item = K>,
    ) -> Self {
        let names = names.into_iter().map(Into::into).collect();
        self.parts.insert(input.to_owned(), names);
        self
    }

    /// Adds a fact found while listing.
    #[must_use]
    pub fn with_fact(mut self, name: &str, value: impl Into<String>) -> Self {
        self.facts.insert(name.to_owned(), value.into());
        self
    }

    /// Adds a label.
    #[must_use]
    pub fn with_label(mut self, name: &str, value: impl Into<String>) -> Self {
        if let Some(labels) = &mut self.labels {
            labels.insert(name.to_owned(), value.into());
        }
        self
    }

    /// Adds the label of this name that a partition has.
    #[must_use]
    pub fn with_label_of(self, name: &str, partition: &Partition) -> Self {
        match partition.certain_labels() {
            None => self.labeled_by_data(),
            Some(labels) => match labels.get(name) {
                Some(value) => self.with_label(name, value),
                None => self,
            },
        }
    }

    /// Adds all labels of a partition.
    #[must_use]
    pub fn with_labels_of(mut self, partition: &Partition) -> Self {
        match partition.certain_labels() {
            None => self.labeled_by_data(),
            Some(found) => {
                if let Some(labels) = &mut self.labels {
                    labels.extend(found.clone());
                }
                self
            }
        }
    }

    /// Leaves the labels to what [`Output::make`](crate::Output::make) finds in the data: its
    /// outcome is [`Outcome::Labeled`](crate::Outcome::Labeled).
    #[must_use]
    pub fn labeled_by_data(mut self) -> Self {
        self.labels = None;
        self
    }

    /// Adds a file outside the lake that counts by its canonical form.
    #[must_use]
    pub fn with_file_of_form(mut self, file: SourceFile, form: Form) -> Self {
        self.forms.insert(file.name.clone(), form);
        self.with_file(file)
    }

    /// Adds a file outside the lake.
    #[must_use]
    pub fn with_file(mut self, file: SourceFile) -> Self {
        self.files.push(file);
        self
    }

    /// Parses the names.
    pub(crate) fn listed(self) -> Result<ListedUnit, InvalidName> {
        let reads = self.reads.into_iter().map(|(input, keys)| {
            let keys = keys.into_iter().map(PartitionKey::try_from);
            Ok((input.try_into()?, keys.collect::<Result<_, _>>()?))
        });
        Ok(Unit {
            partition: self.partition.try_into()?,
            reads: reads.collect::<Result<_, InvalidName>>()?,
            parts: self.parts,
            files: self.files,
            forms: self.forms,
            facts: self.facts,
            labels: self.labels,
        })
    }
}
