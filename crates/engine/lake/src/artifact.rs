//! The files of an artifact that a stage reads.

use std::{fs, path::Path};

use dataflow::Artifact;

use crate::{LakeError, atomic::io_error};

/// Access to the files that an artifact must have. A trait, since the type belongs to `dataflow`,
/// which does not know the lake.
pub trait ReadArtifact {
    /// Returns the path of the file of this name.
    ///
    /// # Errors
    ///
    /// Fails if the artifact lacks it.
    fn path(&self, file: &str) -> Result<&Path, LakeError>;

    /// Parses the file of this name with a function that returns `None` for other bytes.
    ///
    /// # Errors
    ///
    /// Fails if the artifact lacks it, or it cannot be read or parsed.
    fn parsed<T>(&self, file: &str, parse: fn(&[u8]) -> Option<T>) -> Result<T, LakeError>;

    /// Reads the file of this name as text.
    ///
    /// # Errors
    ///
    /// Fails if the artifact lacks it, or it cannot be read or is not UTF-8.
    fn text(&self, file: &str) -> Result<String, LakeError>;
}

impl ReadArtifact for Artifact {
    fn path(&self, file: &str) -> Result<&Path, LakeError> {
        self.file(file).ok_or_else(|| LakeError::MissingFile {
            key: self.key.clone(),
            file: file.to_owned(),
        })
    }

    fn parsed<T>(&self, file: &str, parse: fn(&[u8]) -> Option<T>) -> Result<T, LakeError> {
        let path = self.path(file)?;
        let bytes = fs::read(path).map_err(io_error("read", path))?;
        parse(&bytes).ok_or_else(|| LakeError::BadFile {
            key: self.key.clone(),
            file: file.to_owned(),
        })
    }

    fn text(&self, file: &str) -> Result<String, LakeError> {
        let path = self.path(file)?;
        fs::read_to_string(path).map_err(io_error("read", path))
    }
}
