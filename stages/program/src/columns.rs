//! Columns as a schema wants them, from columns of the same meaning that another library wrote.
//!
//! Libraries differ in the width of offsets and integers, in the names of a list's items, and in what may
//! be null; a column of few different values may be a dictionary of them. What loses nothing is taken; anything
//! else is refused with its column and row.

use std::{collections::BTreeSet, sync::Arc};

use arrow_array::{
    Array, ArrayRef, BooleanArray, FixedSizeListArray, Float64Array, GenericListArray, Int64Array,
    ListArray, OffsetSizeTrait, RecordBatch, StringArray, UInt64Array,
    cast::AsArray,
    new_null_array,
    types::{
        Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type,
        UInt32Type,
    },
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{DataType, FieldRef, Schema, SchemaRef};
use arrow_select::take::take;

use crate::error::TableFault;

/// Metadata of a schema that a program does not write: its name and version.
const SCHEMA: &str = "schema";

/// Returns a table with the columns of a schema, from one that a program wrote.
///
/// # Errors
///
/// Fails if a column is missing, unknown or of another type, or a cell is not finite, or null in a column that is
/// not nullable.
pub(crate) fn conformed(written: &RecordBatch, schema: &Schema) -> Result<RecordBatch, TableFault> {
    let found = written.schema();
    let names = || schema.fields().iter().map(|field| field.name().clone());
    if let Some(unknown) = found
        .fields()
        .iter()
        .find(|field| schema.field_with_name(field.name()).is_err())
    {
        let near = dataflow::nearest(
            unknown.name(),
            names().collect::<Vec<_>>().iter().map(String::as_str),
        )
        .map(str::to_owned);
        return Err(TableFault::UnknownColumn {
            column: unknown.name().clone(),
            near,
        });
    }
    let mut seen = BTreeSet::new();
    if let Some(twice) = found
        .fields()
        .iter()
        .find(|field| !seen.insert(field.name()))
    {
        return Err(TableFault::TwoColumns {
            column: twice.name().clone(),
        });
    }
    let mut arrays = Vec::with_capacity(schema.fields().len());
    for field in schema.fields() {
        let column = written.column_by_name(field.name());
        let column = column.ok_or_else(|| TableFault::NoColumn {
            column: field.name().clone(),
            expected: words(field.data_type()),
        })?;
        let (name, kind) = (field.name(), field.data_type());
        arrays.push(if field.is_nullable() {
            nullable(name, column, kind)?
        } else {
            array(name, column, kind)?
        });
    }
    // What the program says about its rows, e.g. the joints' names, stays.
    let mut metadata = schema.metadata().clone();
    let said = found.metadata().iter();
    let said =
        said.filter(|(key, _)| *key != SCHEMA && *key != "pandas" && !key.starts_with("ARROW"));
    metadata.extend(said.map(|(key, value)| (key.clone(), value.clone())));
    let schema: SchemaRef = Arc::new(Schema::new_with_metadata(schema.fields().clone(), metadata));
    RecordBatch::try_new(schema, arrays).map_err(TableFault::Arrow)
}

/// Returns a type in words.
pub(crate) fn words(kind: &DataType) -> String {
    match kind {
        DataType::Utf8 => "text".to_owned(),
        DataType::Float64 => "float64".to_owned(),
        DataType::Int64 => "int64".to_owned(),
        DataType::Boolean => "boolean".to_owned(),
        DataType::List(item) => format!("a list of {}", words(item.data_type())),
        DataType::FixedSizeList(item, n) => format!("a list of {n} {}", words(item.data_type())),
        DataType::Dictionary(_, item) => format!("a dictionary of {}", words(item)),
        other => other.to_string(),
    }
}

/// Returns the column as this type, null where it is.
fn nullable(column: &str, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
    let valid: Vec<usize> = (0..from.len()).filter(|&row| from.is_valid(row)).collect();
    if *from.data_type() == DataType::Null || valid.is_empty() {
        return Ok(new_null_array(to, from.len()));
    }
    let picked = UInt64Array::from_iter_values(valid.iter().map(|&row| row as u64));
    let picked = take(from, &picked, None).map_err(TableFault::Arrow)?;
    let rows = Rows {
        column,
        row_of: Some(&valid),
    };
    let converted = rows.array(&picked, to)?;
    let mut n = 0..;
    let places = (0..from.len()).map(|row| from.is_valid(row).then(|| n.next()).flatten());
    take(&converted, &places.collect::<UInt64Array>(), None).map_err(TableFault::Arrow)
}

/// Returns the column as this type.
fn array(column: &str, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
    let rows = Rows {
        column,
        row_of: None,
    };
    rows.array(from, to)
}

/// The rows of a column, or the items of its lists.
struct Rows<'a> {
    column: &'a str,
    /// The row of each item; none if the items are the rows.
    row_of: Option<&'a [usize]>,
}

impl Rows<'_> {
    fn row(&self, idx: usize) -> usize {
        self.row_of
            .map_or(idx, |rows| rows.get(idx).copied().unwrap_or(idx))
    }

    fn wrong_type(&self, from: &ArrayRef, to: &DataType) -> TableFault {
        TableFault::WrongType {
            column: self.column.to_owned(),
            found: words(from.data_type()),
            expected: words(to),
        }
    }

    fn array(&self, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
        if let Some(dictionary) = from.as_any_dictionary_opt() {
            let values = take(dictionary.values(), dictionary.keys(), None);
            return self
                .array(&values.map_err(TableFault::Arrow)?, to)
                .map_err(|err| match err {
                    TableFault::WrongType { .. } => self.wrong_type(from, to),
                    err => err,
                });
        }
        if let Some(idx) = (0..from.len()).find(|&idx| from.is_null(idx)) {
            // An empty column of pyarrow has the type `null`.
            return Err(TableFault::Null {
                column: self.column.to_owned(),
                row: self.row(idx),
            });
        }
        match to {
            DataType::Utf8 => self.texts(from, to),
            DataType::Boolean => {
                let bools = from
                    .as_boolean_opt()
                    .ok_or_else(|| self.wrong_type(from, to))?;
                Ok(Arc::new(
                    bools.iter().flatten().map(Some).collect::<BooleanArray>(),
                ))
            }
            DataType::Int64 => self.integers(from, to),
            DataType::Float64 => self.numbers(from, to),
            DataType::List(item) => self.lists(from, to, item),
            DataType::FixedSizeList(item, size) => self.fixed_lists(from, to, item, *size),
            _ => Err(self.wrong_type(from, to)),
        }
    }

    fn texts(&self, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
        let texts: StringArray = match from.data_type() {
            DataType::Utf8 => from.as_string::<i32>().iter().collect(),
            DataType::LargeUtf8 => from.as_string::<i64>().iter().collect(),
            DataType::Utf8View => from.as_string_view().iter().collect(),
            _ => return Err(self.wrong_type(from, to)),
        };
        Ok(Arc::new(texts))
    }

    fn integers(&self, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
        fn widened<T: arrow_array::ArrowPrimitiveType>(from: &ArrayRef) -> Int64Array
        where
            T::Native: Into<i64>,
        {
            from.as_primitive::<T>()
                .iter()
                .map(|value| value.map(Into::into))
                .collect()
        }
        let integers = match from.data_type() {
            DataType::Int64 => from.as_primitive::<Int64Type>().clone(),
            DataType::Int32 => widened::<Int32Type>(from),
            DataType::Int16 => widened::<Int16Type>(from),
            DataType::Int8 => widened::<Int8Type>(from),
            DataType::UInt32 => widened::<UInt32Type>(from),
            DataType::UInt16 => widened::<UInt16Type>(from),
            DataType::UInt8 => widened::<UInt8Type>(from),
            _ => return Err(self.wrong_type(from, to)),
        };
        Ok(Arc::new(Int64Array::from_iter_values(
            integers.iter().flatten(),
        )))
    }

    fn numbers(&self, from: &ArrayRef, to: &DataType) -> Result<ArrayRef, TableFault> {
        let numbers: Vec<f64> = match from.data_type() {
            DataType::Float64 => from
                .as_primitive::<Float64Type>()
                .iter()
                .flatten()
                .collect(),
            DataType::Float32 => from
                .as_primitive::<Float32Type>()
                .iter()
                .flatten()
                .map(f64::from)
                .collect(),
            _ => return Err(self.wrong_type(from, to)),
        };
        match numbers.iter().position(|number| !number.is_finite()) {
            Some(idx) => Err(TableFault::NotFinite {
                column: self.column.to_owned(),
                row: self.row(idx),
                value: numbers[idx],
            }),
            None => Ok(Arc::new(Float64Array::from_iter_values(numbers))),
        }
    }

    /// Returns the items of all lists, one after another, and how many each list has.
    fn items(&self, from: &ArrayRef, to: &DataType) -> Result<(ArrayRef, Vec<usize>), TableFault> {
        let wrong = || self.wrong_type(from, to);
        Ok(match from.data_type() {
            DataType::List(_) => {
                let lists = from.as_list_opt::<i32>().ok_or_else(wrong)?;
                items_of(lists).ok_or_else(wrong)?
            }
            DataType::LargeList(_) => {
                let lists = from.as_list_opt::<i64>().ok_or_else(wrong)?;
                items_of(lists).ok_or_else(wrong)?
            }
            DataType::FixedSizeList(_, size) => {
                let lists = from.as_fixed_size_list_opt().ok_or_else(wrong)?;
                let size = usize::try_from(*size).map_err(|_negative| wrong())?;
                let start = lists.offset() * size;
                let values = lists.values();
                // A slice of fixed lists may keep the values of its whole.
                let values = if values.len() == lists.len() * size {
                    values.clone()
                } else {
                    values.slice(start, lists.len() * size)
                };
                (values, vec![size; lists.len()])
            }
            _ => return Err(wrong()),
        })
    }

    fn of_items(
        &self,
        from: &ArrayRef,
        to: &DataType,
        item: &FieldRef,
    ) -> Result<(ArrayRef, Vec<usize>), TableFault> {
        let (values, lengths) = self.items(from, to)?;
        let rows: Vec<usize> = lengths
            .iter()
            .enumerate()
            .flat_map(|(idx, length)| std::iter::repeat_n(self.row(idx), *length))
            .collect();
        let inner = Rows {
            column: self.column,
            row_of: Some(&rows),
        };
        let values = match (values.data_type(), item.data_type()) {
            // Lists that are all empty have no type of their own.
            (DataType::Null, kind) if values.is_empty() => arrow_array::new_empty_array(kind),
            _ => inner
                .array(&values, item.data_type())
                .map_err(|err| match err {
                    TableFault::WrongType { .. } => self.wrong_type(from, to),
                    err => err,
                })?,
        };
        Ok((values, lengths))
    }

    fn lists(
        &self,
        from: &ArrayRef,
        to: &DataType,
        item: &FieldRef,
    ) -> Result<ArrayRef, TableFault> {
        let (values, lengths) = self.of_items(from, to, item)?;
        let offsets = OffsetBuffer::from_lengths(lengths);
        let lists = ListArray::try_new(Arc::clone(item), offsets, values, None);
        Ok(Arc::new(lists.map_err(TableFault::Arrow)?))
    }

    fn fixed_lists(
        &self,
        from: &ArrayRef,
        to: &DataType,
        item: &FieldRef,
        size: i32,
    ) -> Result<ArrayRef, TableFault> {
        let (values, lengths) = self.of_items(from, to, item)?;
        let expected = usize::try_from(size).unwrap_or_default();
        if let Some(idx) = lengths.iter().position(|length| *length != expected) {
            return Err(TableFault::Length {
                column: self.column.to_owned(),
                row: self.row(idx),
                found: lengths[idx],
                expected,
            });
        }
        let lists = FixedSizeListArray::try_new(Arc::clone(item), size, values, None);
        Ok(Arc::new(lists.map_err(TableFault::Arrow)?))
    }
}

/// Returns the items of lists, one after another, and how many each list has; `None` if an offset is negative.
fn items_of<O: OffsetSizeTrait>(lists: &GenericListArray<O>) -> Option<(ArrayRef, Vec<usize>)> {
    let offsets = lists.offsets().iter();
    let offsets: Option<Vec<usize>> = offsets.map(|offset| offset.to_usize()).collect();
    let offsets = offsets?;
    let lengths: Vec<usize> = offsets.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let start = offsets.first().copied().unwrap_or_default();
    let items = lists.values().slice(start, lengths.iter().sum());
    Some((items, lengths))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{
        DictionaryArray, Float32Array, Int8Array, Int32Array, LargeStringArray, builder,
    };
    use arrow_schema::Field;

    use super::*;

    fn schema(kind: DataType) -> Schema {
        Schema::new(vec![Field::new("x", kind, false)])
    }

    fn batch(array: ArrayRef) -> RecordBatch {
        RecordBatch::try_from_iter_with_nullable([("x", array, true)]).unwrap()
    }

    fn list_of(kind: DataType) -> DataType {
        DataType::List(Arc::new(Field::new("item", kind, false)))
    }

    fn message(array: ArrayRef, kind: DataType) -> String {
        conformed(&batch(array), &schema(kind))
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn what_loses_nothing_is_taken() {
        let cases: [(ArrayRef, DataType); 3] = [
            (
                Arc::new(LargeStringArray::from(vec!["a", "b"])),
                DataType::Utf8,
            ),
            (Arc::new(Int32Array::from(vec![1, -2])), DataType::Int64),
            (
                Arc::new(Float32Array::from(vec![0.5, 2.0])),
                DataType::Float64,
            ),
        ];
        for (array, kind) in cases {
            let taken = conformed(&batch(array), &schema(kind.clone())).unwrap();
            assert_eq!(taken.column(0).data_type(), &kind);
            assert_eq!(taken.num_rows(), 2);
        }
        let mut lists = builder::LargeListBuilder::new(builder::Float64Builder::new());
        for row in [[1.0, 2.0].as_slice(), &[3.0, 4.0]] {
            lists.values().append_slice(row);
            lists.append(true);
        }
        let lists: ArrayRef = Arc::new(lists.finish());
        let item = Arc::new(Field::new("item", DataType::Float64, false));
        for kind in [list_of(DataType::Float64), DataType::FixedSizeList(item, 2)] {
            let taken = conformed(&batch(Arc::clone(&lists)), &schema(kind.clone())).unwrap();
            assert_eq!(taken.column(0).data_type(), &kind);
            // A part of a table too.
            let second = conformed(&batch(lists.slice(1, 1)), &schema(kind)).unwrap();
            assert_eq!(second.column(0).as_ref(), &*taken.column(0).slice(1, 1));
        }
    }

    #[test]
    fn a_dictionary_is_its_values() {
        let keys = Int8Array::from(vec![Some(1), Some(0), Some(1)]);
        let dictionary = |keys: Int8Array, values: ArrayRef| -> ArrayRef {
            Arc::new(DictionaryArray::try_new(keys, values).unwrap())
        };
        let names: ArrayRef = Arc::new(LargeStringArray::from(vec![Some("a"), Some("b"), None]));
        let taken = dictionary(keys.clone(), Arc::clone(&names));
        let taken = conformed(&batch(taken), &schema(DataType::Utf8)).unwrap();
        let expected: ArrayRef = Arc::new(StringArray::from(vec!["b", "a", "b"]));
        assert_eq!(taken.column(0), &expected);
        let counts = dictionary(keys, Arc::new(Int32Array::from(vec![3, 4])));
        let taken = conformed(&batch(Arc::clone(&counts)), &schema(DataType::Int64)).unwrap();
        let expected: ArrayRef = Arc::new(Int64Array::from(vec![4, 3, 4]));
        assert_eq!(taken.column(0), &expected);
        assert_eq!(
            message(counts, DataType::Utf8),
            "column `x` is a dictionary of Int32, expected text"
        );
        // A key that is null, and one of a value that is.
        for keys in [vec![Some(0), None], vec![Some(0), Some(2)]] {
            let column = dictionary(Int8Array::from(keys), Arc::clone(&names));
            assert_eq!(
                message(column, DataType::Utf8),
                "column `x` is null in row 1"
            );
        }
        let items = dictionary(
            Int8Array::from(vec![0, 1]),
            Arc::new(Float64Array::from(vec![1.0, 2.0])),
        );
        let item = Arc::new(Field::new("item", items.data_type().clone(), true));
        let lists = ListArray::try_new(item, OffsetBuffer::from_lengths([2]), items, None).unwrap();
        let taken =
            conformed(&batch(Arc::new(lists)), &schema(list_of(DataType::Float64))).unwrap();
        assert_eq!(taken.num_rows(), 1);
    }

    #[test]
    fn a_column_that_is_there_twice_is_refused() {
        let column: ArrayRef = Arc::new(Float64Array::from(vec![1.0]));
        let field = || Field::new("x", DataType::Float64, false);
        let twice = Schema::new(vec![field(), field()]);
        let twice =
            RecordBatch::try_new(Arc::new(twice), vec![Arc::clone(&column), column]).unwrap();
        let said = conformed(&twice, &schema(DataType::Float64))
            .unwrap_err()
            .to_string();
        assert_eq!(said, "there are two columns `x`");
    }

    #[test]
    fn faults_name_column_type_and_row() {
        let numbers =
            |values: Vec<Option<f64>>| -> ArrayRef { Arc::new(Float64Array::from(values)) };
        assert_eq!(
            message(numbers(vec![Some(1.0)]), DataType::Utf8),
            "column `x` is float64, expected text"
        );
        assert_eq!(
            message(numbers(vec![Some(1.0), Some(f64::NAN)]), DataType::Float64),
            "column `x` is NaN in row 1, expected a finite number"
        );
        assert_eq!(
            message(numbers(vec![Some(1.0), None]), DataType::Float64),
            "column `x` is null in row 1"
        );
        let mut lists = builder::ListBuilder::new(builder::Float64Builder::new());
        for row in [[1.0, 2.0].as_slice(), &[3.0], &[f64::INFINITY]] {
            lists.values().append_slice(row);
            lists.append(true);
        }
        let lists: ArrayRef = Arc::new(lists.finish());
        assert_eq!(
            message(Arc::clone(&lists), list_of(DataType::Float64)),
            "column `x` is inf in row 2, expected a finite number"
        );
        let item = Arc::new(Field::new("item", DataType::Float64, false));
        assert_eq!(
            message(lists.slice(0, 2), DataType::FixedSizeList(item, 2)),
            "column `x` has a list of 1 in row 1, expected 2"
        );
        let other = batch(numbers(vec![Some(1.0)]));
        let renamed = Schema::new(vec![Field::new("lift_m", DataType::Float64, false)]);
        let unknown = conformed(&other, &renamed).unwrap_err().to_string();
        assert_eq!(unknown, "there is no column `x`");
        let both = Schema::new(vec![
            Field::new("x", DataType::Float64, false),
            Field::new("lift_m", DataType::Float64, false),
        ]);
        let missing = conformed(&other, &both).unwrap_err().to_string();
        assert_eq!(missing, "column `lift_m` (float64) is missing");
    }
}
