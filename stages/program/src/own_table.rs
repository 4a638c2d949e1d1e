//! Tables whose columns the pipeline file declares.

use std::{collections::HashMap, sync::Arc};

use arrow_array::{Array, RecordBatch, cast::AsArray, types::Int64Type};
use arrow_schema::{DataType, Field, Schema};
use dataflow::Inputs;
use lake::ReadArtifact;

use crate::{
    config::{ColumnType, ProgramConfig},
    error::{ProgramError, TableFault},
};

/// Version of the tables of programs: their columns are options, which are fingerprinted by themselves.
const VERSION: u32 = 1;

/// Returns the schema's name and version.
pub(crate) fn version(artifact: &str) -> String {
    format!("{artifact}/{VERSION}")
}

/// Returns the columns of a program's own table.
pub(crate) fn schema(config: &ProgramConfig) -> Schema {
    let fields = config.columns.iter().map(|(name, column)| {
        let mut notes = HashMap::from([("description".to_owned(), column.about.clone())]);
        if let Some(unit) = &column.unit {
            notes.insert("unit".to_owned(), unit.clone());
        }
        Field::new(name, data_type(column.kind), false).with_metadata(notes)
    });
    let metadata = HashMap::from([("schema".to_owned(), version(&config.makes))]);
    Schema::new_with_metadata(fields.collect::<Vec<_>>(), metadata)
}

fn data_type(kind: ColumnType) -> DataType {
    let list = |item| DataType::List(Arc::new(Field::new("item", item, false)));
    match kind {
        ColumnType::Text => DataType::Utf8,
        ColumnType::Number => DataType::Float64,
        ColumnType::Integer => DataType::Int64,
        ColumnType::Boolean => DataType::Boolean,
        ColumnType::Numbers => list(DataType::Float64),
        ColumnType::Integers => list(DataType::Int64),
    }
}

/// Checks that there is one row for each row of an input, in its order.
///
/// # Errors
///
/// Fails if the input has no such column of texts or integers, or the rows differ.
pub(crate) fn check_rows(
    inputs: &Inputs,
    input: &str,
    column: &str,
    batch: &RecordBatch,
) -> Result<(), ProgramError> {
    let mut asked = Vec::new();
    for artifact in inputs.artifacts(input) {
        artifact.path(lake::table::FILE)?;
        let read = lake::table::read_batch(artifact)?;
        let values = values(&read, column).ok_or_else(|| ProgramError::NoRows {
            input: input.to_owned(),
            column: column.to_owned(),
            key: artifact.key.to_string(),
        })?;
        asked.extend(values);
    }
    let made = values(batch, column).unwrap_or_default();
    Ok(same_rows(column, input, &asked, &made)?)
}

/// Checks that the rows made are those asked for, in their order.
pub(crate) fn same_rows(
    column: &str,
    input: &str,
    asked: &[String],
    made: &[String],
) -> Result<(), TableFault> {
    let differs = (0..asked.len().max(made.len())).find(|&row| asked.get(row) != made.get(row));
    let Some(row) = differs else {
        return Ok(());
    };
    Err(TableFault::Rows {
        column: column.to_owned(),
        input: input.to_owned(),
        row,
        found: made.get(row).cloned(),
        expected: asked.get(row).cloned(),
        n_found: made.len(),
        n_expected: asked.len(),
    })
}

/// Returns the values of a column of texts or integers.
pub(crate) fn values(batch: &RecordBatch, column: &str) -> Option<Vec<String>> {
    let array = batch.column_by_name(column)?;
    match array.data_type() {
        DataType::Utf8 => {
            let texts = array.as_string::<i32>();
            Some(
                (0..texts.len())
                    .map(|row| texts.value(row).to_owned())
                    .collect(),
            )
        }
        DataType::Int64 => {
            let integers = array.as_primitive::<Int64Type>();
            Some(
                (0..integers.len())
                    .map(|row| integers.value(row).to_string())
                    .collect(),
            )
        }
        _ => None,
    }
}
