//! Files outside the lake.

use std::path::{Path, PathBuf};

/// A file outside the lake that a unit reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Its name in the fingerprint: relative to the dataset, never an absolute path.
    pub name: String,
    /// Its path.
    pub path: PathBuf,
}

impl SourceFile {
    /// Names `path` by its last component.
    pub fn named_by_file(path: &Path) -> Self {
        Self {
            name: path.file_name().map_or_else(
                || path.display().to_string(),
                |name| name.to_string_lossy().into_owned(),
            ),
            path: path.to_owned(),
        }
    }

    /// Names `path` by its role in the stage, e.g. by the option that holds the path: then its own
    /// name does not matter.
    pub fn named(name: &str, path: &Path) -> Self {
        Self {
            name: name.to_owned(),
            path: path.to_owned(),
        }
    }
}
