//! Comma-separated values as a table.

use std::{path::Path, sync::Arc};

use datafusion::arrow::{
    array::{ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray},
    datatypes::{Field, Schema},
};

use super::scan::FileTable;

/// Reads a file with a header.
///
/// A column is of whole numbers, decimals, or true and false, if every value in it is one; empty values are
/// missing. Digits after a zero are a name: `007` stays text.
pub(super) fn csv(path: &Path) -> anyhow::Result<FileTable> {
    let mut reader = csv::Reader::from_path(path)?;
    let names: Vec<String> = reader.headers()?.iter().map(str::to_owned).collect();
    let mut columns: Vec<Vec<Option<String>>> = vec![Vec::new(); names.len()];
    for record in reader.records() {
        let record = record?;
        for (column, value) in columns.iter_mut().zip(record.iter()) {
            column.push((!value.is_empty()).then(|| value.to_owned()));
        }
    }
    let columns: Vec<ArrayRef> = columns.into_iter().map(column).collect();
    let fields = names.iter().zip(&columns);
    let fields = fields.map(|(name, column)| Field::new(name, column.data_type().clone(), true));
    let schema = Arc::new(Schema::new(fields.collect::<Vec<_>>()));
    Ok(FileTable::of_rows(RecordBatch::try_new(schema, columns)?))
}

fn column(values: Vec<Option<String>>) -> ArrayRef {
    if let Some(whole) = all(&values, whole) {
        return Arc::new(Int64Array::from(whole));
    }
    if let Some(decimals) = all(&values, decimal) {
        return Arc::new(Float64Array::from(decimals));
    }
    if let Some(truths) = all(&values, |value| value.to_lowercase().parse().ok()) {
        return Arc::new(BooleanArray::from(truths));
    }
    Arc::new(StringArray::from(values))
}

/// Reads all values, if each is one and one is there.
fn all<T>(values: &[Option<String>], read: impl Fn(&str) -> Option<T>) -> Option<Vec<Option<T>>> {
    if values.iter().all(Option::is_none) {
        return None;
    }
    let values = values.iter().map(|value| match value {
        Some(text) => read(text).map(Some),
        None => Some(None),
    });
    values.collect()
}

fn whole(text: &str) -> Option<i64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let is_name = digits.starts_with('+') || (digits.starts_with('0') && digits.len() > 1);
    if is_name { None } else { text.parse().ok() }
}

fn decimal(text: &str) -> Option<f64> {
    let digits = text.strip_prefix('-').unwrap_or(text).as_bytes();
    let is_name = match digits {
        [b'0', second, ..] => !matches!(second, b'.' | b'e' | b'E'),
        [first, ..] => !first.is_ascii_digit() && *first != b'.',
        [] => true,
    };
    if is_name { None } else { text.parse().ok() }
}

#[cfg(test)]
mod tests {
    use datafusion::arrow::datatypes::DataType;

    use super::*;

    #[test]
    fn values_are_numbers_only_where_all_are() {
        let kind = |values: &[&str]| {
            let values = values
                .iter()
                .map(|value| (!value.is_empty()).then(|| (*value).to_owned()));
            column(values.collect()).data_type().clone()
        };
        assert_eq!(kind(&["1", "", "-20"]), DataType::Int64);
        assert_eq!(kind(&["1", "2.5", "1e-3", "0.1"]), DataType::Float64);
        assert_eq!(kind(&["true", "FALSE"]), DataType::Boolean);
        for text in [
            &["007", "025"][..],
            &["1", "x"],
            &["", ""],
            &["2020-01-01"],
            &["nan"],
            &["+1"],
        ] {
            assert_eq!(kind(text), DataType::Utf8, "{text:?}");
        }
    }
}
