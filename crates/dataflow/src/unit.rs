//! Units of work: one partition of one output of one stage.

use std::collections::BTreeMap;

use crate::{form::Form, source_file::SourceFile};

/// One partition to make and what it reads.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Unit {
    /// The partition's key, e.g. the sequence's or the object's name.
    pub partition: String,
    /// Keys of the partitions read, by input name (or by an earlier output of the same stage).
    pub reads: BTreeMap<String, Vec<String>>,
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
}

impl Unit {
    /// Returns a unit that reads nothing yet.
    pub fn new(partition: impl Into<String>) -> Self {
        Self {
            partition: partition.into(),
            ..Self::default()
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
}
