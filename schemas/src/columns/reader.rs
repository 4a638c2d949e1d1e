//! Reading columns.

use arrow_array::RecordBatch;

use super::{
    Row,
    cell::{Cell, Column, is_null},
};
use crate::SchemaError;

/// Key of the schema's name and version in the file's metadata.
pub(super) const SCHEMA: &str = "schema";
/// Key of the joints' names, separated by commas, in the file's metadata.
pub const JOINTS: &str = "joints";

/// A version that is read as a later one, whose columns it has, but for some that may be null.
struct ReadAs {
    older: &'static str,
    version: &'static str,
    /// Whether it has 0 where the later one has null; a depth of 0 that was measured reads as null, too.
    zero_is_null: bool,
}

const READ_AS: [ReadAs; 3] = [
    ReadAs {
        older: "candidates/4",
        version: "candidates/6",
        zero_is_null: true,
    },
    ReadAs {
        older: "candidates/5",
        version: "candidates/6",
        zero_is_null: false,
    },
    ReadAs {
        older: "rollouts/6",
        version: "rollouts/7",
        zero_is_null: true,
    },
];

/// Reads the columns of one version of a schema by name.
pub(crate) struct Reader<'a> {
    batch: &'a RecordBatch,
    /// Whether the batch is of an older version.
    is_older: bool,
    /// Whether 0 stands for null where a cell may be null.
    zero_is_null: bool,
}

impl<'a> Reader<'a> {
    /// Refuses a batch of another schema, or of a version that is not read as this one.
    pub(crate) fn new(batch: &'a RecordBatch, version: &str) -> Result<Self, SchemaError> {
        let mut reader = Self {
            batch,
            is_older: false,
            zero_is_null: false,
        };
        let found = reader.noted(SCHEMA);
        if found == version {
            return Ok(reader);
        }
        let mut read_as = READ_AS.iter();
        let Some(read_as) = read_as.find(|as_| as_.older == found && as_.version == version) else {
            return Err(SchemaError::Version {
                expected: version.to_owned(),
                found: found.to_owned(),
            });
        };
        reader.is_older = true;
        reader.zero_is_null = read_as.zero_is_null;
        Ok(reader)
    }

    /// Reads all rows.
    pub(crate) fn rows<R: Row>(&self) -> Result<Vec<R>, SchemaError> {
        (0..self.batch.num_rows())
            .map(|row| R::read(self, row))
            .collect()
    }

    /// Reads the first row, of at least one.
    pub(crate) fn first<R: Row>(&self) -> Result<R, SchemaError> {
        match self.batch.num_rows() {
            0 => Err(SchemaError::Rows {
                expected: "at least one",
                found: 0,
            }),
            _ => R::read(self, 0),
        }
    }

    /// Reads the only row.
    pub(crate) fn row<R: Row>(&self) -> Result<R, SchemaError> {
        match self.batch.num_rows() {
            1 => R::read(self, 0),
            found => Err(SchemaError::Rows {
                expected: "one",
                found,
            }),
        }
    }

    /// Reads a cell of a column; one that an older version lacks is null if it may be.
    pub(crate) fn cell<T: Cell>(&self, name: &str, row: usize) -> Result<T, SchemaError> {
        let array = self.batch.column_by_name(name);
        let Some(array) = array else {
            let null = T::NULL.filter(|_| self.is_older);
            return null.ok_or_else(|| SchemaError::Column {
                column: name.to_owned(),
                expected: T::TYPE,
            });
        };
        if T::NULL.is_none() && is_null(array, row) {
            return Err(SchemaError::Null {
                table: self.noted(SCHEMA).to_owned(),
                column: name.to_owned(),
                row,
            });
        }
        let column = Column {
            name,
            array,
            zero_is_null: self.zero_is_null,
        };
        T::read(&column, row)
    }

    /// Reads a cell of a column that only some versions have.
    pub(crate) fn cell_if_there<T: Cell>(
        &self,
        name: &str,
        row: usize,
    ) -> Result<Option<T>, SchemaError> {
        let is_there = self.batch.column_by_name(name).is_some();
        is_there.then(|| self.cell(name, row)).transpose()
    }

    /// Returns a list of names from the metadata; empty if it is absent.
    pub(crate) fn names(&self, key: &str) -> Vec<String> {
        let names = self.noted(key).split(',');
        let names = names.filter(|name| !name.is_empty());
        names.map(str::to_owned).collect()
    }

    /// Returns the joints' names from the metadata.
    pub(crate) fn joints(&self) -> Result<Vec<String>, SchemaError> {
        let joints: Vec<String> = self.noted(JOINTS).split(',').map(str::to_owned).collect();
        if joints.iter().any(String::is_empty) {
            let message = "the metadata names no joints".to_owned();
            return Err(SchemaError::invalid(JOINTS, message));
        }
        Ok(joints)
    }

    fn noted(&self, key: &str) -> &str {
        let metadata = self.batch.schema_ref().metadata();
        metadata.get(key).map_or("", String::as_str)
    }
}
