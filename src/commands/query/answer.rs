//! The answer to a question: rows under the names that the question gives them.

use std::{collections::BTreeSet, sync::Arc};

use datafusion::arrow::{
    array::{ArrayRef, RecordBatch, RecordBatchOptions, StringArray},
    datatypes::{Field, Schema},
};

use crate::outcome::CommandError;

/// Rows, and the names of their columns: each with its table, if it is one of a table.
pub(super) struct Answer {
    pub(super) names: Vec<(String, Option<String>)>,
    pub(super) rows: RecordBatch,
}

impl Answer {
    /// Returns an answer of names.
    pub(super) fn of_names(names: Vec<String>) -> anyhow::Result<RecordBatch> {
        let column: ArrayRef = Arc::new(StringArray::from(names));
        Ok(RecordBatch::try_from_iter([("name", column)])?)
    }

    /// Returns the rows with the names that the question writes.
    ///
    /// Of two columns with one name, the second is named for its table: `mass_kg:objects`.
    pub(super) fn named(self, written: &[Option<String>]) -> Result<RecordBatch, CommandError> {
        let names = names(&self.names, written);
        let mut taken = BTreeSet::new();
        let schema = self.rows.schema();
        let mut fields = Vec::new();
        for ((name, (_, table)), field) in names.into_iter().zip(&self.names).zip(schema.fields()) {
            let name = match table {
                Some(table) if taken.contains(&name) => format!("{name}:{table}"),
                _ => name,
            };
            if !taken.insert(name.clone()) {
                return Err(CommandError::usage(
                    format!("two columns of the answer are called `{name}`"),
                    "name one of them with `as`",
                ));
            }
            fields.push(Field::new(name, field.data_type().clone(), true));
        }
        let options = RecordBatchOptions::new().with_row_count(Some(self.rows.num_rows()));
        let columns = self.rows.columns().to_vec();
        RecordBatch::try_new_with_options(Arc::new(Schema::new(fields)), columns, &options)
            .map_err(|err| CommandError::failed(err, None))
    }
}

/// The columns' names: as written, and where `*` stands for several, as they are.
fn names(own: &[(String, Option<String>)], written: &[Option<String>]) -> Vec<String> {
    let mut names: Vec<String> = own.iter().map(|(name, _)| name.clone()).collect();
    let n_stars = written.iter().filter(|name| name.is_none()).count();
    let n_before = written.iter().take_while(|name| name.is_some()).count();
    let is_known = match n_stars {
        0 => written.len() == names.len(),
        _ => written.len() <= names.len() + n_stars,
    };
    if !is_known {
        return names;
    }
    for (name, written) in names.iter_mut().zip(written.iter().take(n_before)) {
        if let Some(written) = written {
            name.clone_from(written);
        }
    }
    let after = written.iter().rev().take_while(|name| name.is_some());
    if n_stars > 0 {
        for (name, written) in names.iter_mut().rev().zip(after) {
            if let Some(written) = written {
                name.clone_from(written);
            }
        }
    }
    names
}
