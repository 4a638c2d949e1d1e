//! Result of an export.

use std::collections::BTreeMap;

/// The files of an export, and the information that its format could not hold.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Export {
    /// Bytes by path, relative to the export's folder, with `/` between its parts.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Information that the format could not hold, one fact each.
    pub lost: Vec<String>,
}

impl Export {
    /// Adds a file.
    pub(crate) fn put(&mut self, path: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.into(), bytes.into());
    }
}
