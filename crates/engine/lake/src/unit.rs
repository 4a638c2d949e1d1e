//! Typed inputs and outputs of a unit.
//!
//! These extend `dataflow`'s types, which know nothing of tables: hence traits.

use std::{fs::File, io::Write};

use dataflow::{Artifact, Context, Inputs, SourceFile};
use schemas::Table;

use crate::{LakeError, atomic::io_error, table};

/// Typed access to a unit's inputs.
pub trait ReadInputs {
    /// Returns the only partition of an input.
    ///
    /// # Errors
    ///
    /// Fails if the unit reads none or several of it.
    fn artifact(&self, input: &'static str) -> Result<&Artifact, LakeError>;

    /// Returns a file outside the lake by its name in the fingerprint, e.g. `hand`.
    ///
    /// # Errors
    ///
    /// Fails if the unit reads no such file.
    fn source(&self, name: &'static str) -> Result<&SourceFile, LakeError>;

    /// Reads the only partition of the input named like the table.
    ///
    /// # Errors
    ///
    /// Fails if there is none, if there are several, or it cannot be read.
    fn one<T: Table>(&self) -> Result<T, LakeError>;

    /// Reads the only partition of the input named like the table; `None` if there is none.
    ///
    /// # Errors
    ///
    /// Fails if there are several, or it cannot be read.
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
        at_most_one(self, input)?.ok_or(LakeError::MissingInput { what: input })
    }

    fn source(&self, name: &'static str) -> Result<&SourceFile, LakeError> {
        let file = self.files().iter().find(|file| file.name == name);
        file.ok_or(LakeError::MissingInput { what: name })
    }

    fn one<T: Table>(&self) -> Result<T, LakeError> {
        table::read(self.artifact(T::NAME)?)
    }

    fn optional<T: Table>(&self) -> Result<Option<T>, LakeError> {
        at_most_one(self, T::NAME)?.map(table::read).transpose()
    }

    fn all<T: Table>(&self) -> Result<Vec<T>, LakeError> {
        self.artifacts(T::NAME).iter().map(table::read).collect()
    }
}

fn at_most_one<'a>(
    inputs: &'a Inputs,
    input: &'static str,
) -> Result<Option<&'a Artifact>, LakeError> {
    match inputs.artifacts(input) {
        [] => Ok(None),
        [only] => Ok(Some(only)),
        several => Err(LakeError::SeveralInputs {
            what: input,
            found: several.len(),
        }),
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

    /// Writes a chart of the artifact, `NAME.svg`, if there is anything to draw.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    fn write_chart(&self, name: &str, svg: Option<String>) -> Result<(), LakeError> {
        svg.map_or(Ok(()), |svg| {
            self.write_file(&format!("{name}.svg"), svg.as_bytes())
        })
    }
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
