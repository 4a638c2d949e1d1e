//! Writing columns.

use std::{collections::HashMap, sync::Arc};

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{Field, FieldRef, Schema};

use super::{Cell, Row, reader::SCHEMA};
use crate::SchemaError;

/// A builder of columns, each with its unit and description.
pub(crate) struct Writer {
    metadata: HashMap<String, String>,
    fields: Vec<FieldRef>,
    arrays: Vec<ArrayRef>,
    not_finite: Option<SchemaError>,
}

impl Writer {
    /// Writes rows as the columns of a schema, e.g. `rollouts/1`.
    pub(crate) fn of<R: Row>(version: &str, rows: &[R]) -> Self {
        let mut writer = Self {
            metadata: HashMap::from([(SCHEMA.to_owned(), version.to_owned())]),
            fields: Vec::new(),
            arrays: Vec::new(),
            not_finite: None,
        };
        writer.rows(rows);
        writer
    }

    /// Adds a list of names to the metadata: the order of the rows' lists, e.g. of the joints.
    pub(crate) fn with_names(mut self, key: &str, names: &[String]) -> Self {
        self.metadata.insert(key.to_owned(), names.join(","));
        self
    }

    /// Adds the columns of rows.
    pub(crate) fn rows<R: Row>(&mut self, rows: &[R]) {
        R::write(&rows.iter().collect::<Vec<_>>(), self);
    }

    /// Adds a column.
    pub(crate) fn column<T: Cell>(
        &mut self,
        name: &str,
        unit: Option<&str>,
        about: &str,
        cells: &[&T],
    ) {
        let broken = cells.iter().position(|cell| !cell.is_finite());
        if let (Some(row), None) = (broken, &self.not_finite) {
            let column = name.to_owned();
            self.not_finite = Some(SchemaError::NotFinite { column, row });
        }
        let array = T::array(cells);
        let mut metadata = HashMap::from([("description".to_owned(), about.to_owned())]);
        if let Some(unit) = unit.or(T::UNIT) {
            metadata.insert("unit".to_owned(), unit.to_owned());
        }
        let field =
            Field::new(name, array.data_type().clone(), T::NULL.is_some()).with_metadata(metadata);
        self.fields.push(Arc::new(field));
        self.arrays.push(array);
    }

    /// Adds a column that follows from the rows.
    pub(crate) fn computed<T: Cell>(
        &mut self,
        name: &str,
        unit: Option<&str>,
        about: &str,
        cells: &[T],
    ) {
        self.column(name, unit, about, &cells.iter().collect::<Vec<_>>());
    }

    /// Returns the columns without their rows.
    pub(crate) fn schema(&self) -> Schema {
        Schema::new_with_metadata(self.fields.clone(), self.metadata.clone())
    }

    /// Returns the columns, if every number in them is finite.
    pub(crate) fn into_batch(self) -> Result<RecordBatch, SchemaError> {
        let schema = Arc::new(self.schema());
        match self.not_finite {
            Some(err) => Err(err),
            None => Ok(RecordBatch::try_new(schema, self.arrays)?),
        }
    }
}
