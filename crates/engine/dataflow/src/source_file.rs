//! Files outside the lake.

use std::path::{Path, PathBuf};

use crate::stamp::Stamp;

/// A file outside the lake that a unit reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Its name in the fingerprint: relative to the dataset, never an absolute path.
    pub name: String,
    /// Its path.
    pub path: PathBuf,
    /// Its stamp, where its stage has looked at it: then it is not looked at again.
    pub stamp: Option<Stamp>,
}

impl SourceFile {
    /// Names a file that nobody has looked at.
    pub fn new(name: String, path: PathBuf) -> Self {
        Self {
            name,
            path,
            stamp: None,
        }
    }

    /// Names `path` by its last component.
    pub fn named_by_file(path: &Path) -> Self {
        let name = path.file_name().map_or_else(
            || path.display().to_string(),
            |name| name.to_string_lossy().into_owned(),
        );
        Self::new(name, path.to_owned())
    }

    /// Names `path` by its role in the stage, e.g. by the option that holds the path: then its own
    /// name does not matter.
    pub fn named(name: &str, path: &Path) -> Self {
        Self::new(name.to_owned(), path.to_owned())
    }
}
