//! What is exported.

use std::collections::BTreeMap;

/// The files of an export, and what its format could not hold.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Export {
    /// Bytes by path, relative to the export's folder, with `/` between its parts.
    pub files: BTreeMap<String, Vec<u8>>,
    /// What is not in it, one fact each.
    pub lost: Vec<String>,
}

impl Export {
    /// Adds a file.
    pub(crate) fn put(&mut self, path: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.into(), bytes.into());
    }
}
