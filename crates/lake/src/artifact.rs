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

    /// Reads the file of this name.
    ///
    /// # Errors
    ///
    /// Fails if the artifact lacks it, or it cannot be read.
    fn bytes(&self, file: &str) -> Result<Vec<u8>, LakeError>;

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

    fn bytes(&self, file: &str) -> Result<Vec<u8>, LakeError> {
        let path = self.path(file)?;
        fs::read(path).map_err(io_error("read", path))
    }

    fn text(&self, file: &str) -> Result<String, LakeError> {
        let path = self.path(file)?;
        fs::read_to_string(path).map_err(io_error("read", path))
    }
}
