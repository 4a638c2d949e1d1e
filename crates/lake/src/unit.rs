//! Typed inputs and outputs of a unit.
//!
//! These extend `dataflow`'s types, which know nothing of tables: hence traits.

use std::{fs::File, io::Write};

use dataflow::{Artifact, Context, Inputs, SourceFile};
use schemas::Table;

use crate::{LakeError, atomic::io_error, table};

/// Typed access to a unit's inputs.
pub trait ReadInputs {
    /// Returns the only partition of an input, or the first one.
    ///
    /// # Errors
    ///
    /// Fails if the unit reads no partition of it.
    fn artifact(&self, input: &'static str) -> Result<&Artifact, LakeError>;

    /// Returns a file outside the lake by its number among those of the unit; `what` is its name in the
    /// error.
    ///
    /// # Errors
    ///
    /// Fails if the unit reads fewer files.
    fn source(&self, number: usize, what: &'static str) -> Result<&SourceFile, LakeError>;

    /// Reads the only partition of the input named like the table.
    ///
    /// # Errors
    ///
    /// Fails if there is none, or it cannot be read.
    fn one<T: Table>(&self) -> Result<T, LakeError>;

    /// Reads the only partition of the input named like the table; `None` if there is none.
    ///
    /// # Errors
    ///
    /// Fails if it cannot be read.
    fn optional<T: Table>(&self) -> Result<Option<T>, LakeError>;

    /// Reads every partition of the input named like the table, in the order in which the unit names
    /// them.
    ///
    /// # Errors
    ///
    /// Fails if one cannot be read.
    fn all<T: Table>(&self) -> Result<Vec<T>, LakeError>;
}

impl ReadInputs for Inputs {
    fn artifact(&self, input: &'static str) -> Result<&Artifact, LakeError> {
        let first = self.artifacts(input).first();
        first.ok_or(LakeError::MissingInput { what: input })
    }

    fn source(&self, number: usize, what: &'static str) -> Result<&SourceFile, LakeError> {
        let file = self.files().get(number);
        file.ok_or(LakeError::MissingInput { what })
    }

    fn one<T: Table>(&self) -> Result<T, LakeError> {
        table::read(self.artifact(T::NAME)?)
    }

    fn optional<T: Table>(&self) -> Result<Option<T>, LakeError> {
        self.artifacts(T::NAME).first().map(table::read).transpose()
    }

    fn all<T: Table>(&self) -> Result<Vec<T>, LakeError> {
        self.artifacts(T::NAME).iter().map(table::read).collect()
    }
}

/// Typed access to a unit's artifact.
pub trait WriteArtifact {
    /// Writes the artifact's table.
    ///
    /// # Errors
    ///
    /// Fails if a number is not finite, or the file cannot be written.
    fn write<T: Table>(&self, table: &T) -> Result<(), LakeError>;

    /// Writes another file of the artifact.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    fn write_file(&self, file: &str, bytes: &[u8]) -> Result<(), LakeError>;
}

impl WriteArtifact for Context<'_> {
    fn write<T: Table>(&self, table: &T) -> Result<(), LakeError> {
        table::write(self.folder(), table)
    }

    fn write_file(&self, file: &str, bytes: &[u8]) -> Result<(), LakeError> {
        let path = self.folder().join(file);
        let written = File::create(&path).and_then(|mut file| file.write_all(bytes));
        written.map_err(io_error("write", &path))
    }
}
