//! Types of a column's cells.

use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BooleanArray, FixedSizeListArray, Float64Array, Int64Array, ListArray,
    StringArray,
    cast::AsArray,
    types::{Float64Type, Int64Type},
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{DataType, Field, FieldRef};
use spatial::Pose;

use crate::SchemaError;

/// The value of a column in one row.
pub(crate) trait Cell: Sized {
    /// Name of the type in errors.
    const TYPE: &'static str;
    /// The default unit.
    const UNIT: Option<&'static str> = None;
    /// The value of a null cell; none if a cell must not be null.
    const NULL: Option<Self> = None;

    /// Returns the column of these cells.
    fn array(cells: &[&Self]) -> ArrayRef;

    /// Reads the cell in this row.
    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError>;

    /// Whether all its numbers are finite.
    fn is_finite(&self) -> bool {
        true
    }
}

/// A column to be read.
pub(crate) struct Column<'a> {
    pub(super) name: &'a str,
    pub(super) array: &'a ArrayRef,
    /// Whether 0 stands for null.
    pub(super) zero_is_null: bool,
}

impl Column<'_> {
    /// Returns the error for a value that the column cannot hold.
    pub(crate) fn invalid(&self, message: String) -> SchemaError {
        SchemaError::invalid(self.name, message)
    }

    /// Returns the array if it has the type of `T`.
    fn typed<T: Cell, A>(&self, array: Option<A>) -> Result<A, SchemaError> {
        array.ok_or_else(|| SchemaError::Column {
            column: self.name.to_owned(),
            expected: T::TYPE,
        })
    }

    /// Returns the list in this row of a list column.
    fn list<T: Cell>(&self, row: usize) -> Result<ArrayRef, SchemaError> {
        let lists = self.typed::<T, _>(self.array.as_list_opt::<i32>())?;
        Ok(lists.value(row))
    }

    /// Fills `numbers`; fails unless the lengths agree.
    fn numbers<T: Cell>(&self, values: &ArrayRef, numbers: &mut [f64]) -> Result<(), SchemaError> {
        let values = self.typed::<T, _>(values.as_primitive_opt::<Float64Type>())?;
        SchemaError::check_length(self.name, "numbers", values.values(), numbers.len())?;
        numbers.copy_from_slice(values.values());
        Ok(())
    }
}

impl Cell for String {
    const TYPE: &'static str = "utf8";

    fn array(cells: &[&Self]) -> ArrayRef {
        Arc::new(StringArray::from_iter_values(cells))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let array = column.typed::<Self, _>(column.array.as_string_opt::<i32>())?;
        Ok(array.value(row).to_owned())
    }
}

impl Cell for bool {
    const TYPE: &'static str = "bool";

    fn array(cells: &[&Self]) -> ArrayRef {
        Arc::new(
            cells
                .iter()
                .map(|&&cell| Some(cell))
                .collect::<BooleanArray>(),
        )
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let array = column.typed::<Self, _>(column.array.as_boolean_opt())?;
        Ok(array.value(row))
    }
}

impl Cell for i64 {
    const TYPE: &'static str = "i64";
    const UNIT: Option<&'static str> = Some("1");

    fn array(cells: &[&Self]) -> ArrayRef {
        Arc::new(Int64Array::from_iter_values(
            cells.iter().map(|&&cell| cell),
        ))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let array = column.array.as_primitive_opt::<Int64Type>();
        Ok(column.typed::<Self, _>(array)?.value(row))
    }
}

impl Cell for u32 {
    const TYPE: &'static str = i64::TYPE;
    const UNIT: Option<&'static str> = i64::UNIT;

    fn array(cells: &[&Self]) -> ArrayRef {
        let cells = cells.iter().map(|&&cell| i64::from(cell));
        Arc::new(Int64Array::from_iter_values(cells))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let n = i64::read(column, row)?;
        Self::try_from(n).map_err(|err| column.invalid(err.to_string()))
    }
}

impl Cell for f64 {
    const TYPE: &'static str = "f64";

    fn array(cells: &[&Self]) -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(
            cells.iter().map(|&&cell| cell),
        ))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let array = column.array.as_primitive_opt::<Float64Type>();
        Ok(column.typed::<Self, _>(array)?.value(row))
    }

    fn is_finite(&self) -> bool {
        Self::is_finite(*self)
    }
}

/// None is null.
impl Cell for Option<f64> {
    const TYPE: &'static str = f64::TYPE;
    const NULL: Option<Self> = Some(None);

    fn array(cells: &[&Self]) -> ArrayRef {
        Arc::new(cells.iter().map(|&&cell| cell).collect::<Float64Array>())
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let array = column.array.as_primitive_opt::<Float64Type>();
        let array = column.typed::<Self, _>(array)?;
        let number = array.is_valid(row).then(|| array.value(row));
        Ok(number.filter(|number| !(column.zero_is_null && *number == 0.0)))
    }

    fn is_finite(&self) -> bool {
        self.is_none_or(f64::is_finite)
    }
}

impl<const N: usize> Cell for [f64; N] {
    const TYPE: &'static str = "a fixed list of f64";

    fn array(cells: &[&Self]) -> ArrayRef {
        fixed_lists(N, cells.iter().flat_map(|cell| cell.iter().copied()))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let lists = column.typed::<Self, _>(column.array.as_fixed_size_list_opt())?;
        let mut cell = [0.0; N];
        column.numbers::<Self>(&lists.value(row), &mut cell)?;
        Ok(cell)
    }

    fn is_finite(&self) -> bool {
        self.iter().copied().all(f64::is_finite)
    }
}

/// The numbers in row-major order.
impl<const M: usize, const N: usize> Cell for [[f64; M]; N] {
    const TYPE: &'static str = <[f64; N]>::TYPE;

    fn array(cells: &[&Self]) -> ArrayRef {
        let numbers = cells.iter().flat_map(|cell| cell.as_flattened());
        fixed_lists(M * N, numbers.copied())
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let lists = column.typed::<Self, _>(column.array.as_fixed_size_list_opt())?;
        let mut cell = [[0.0; M]; N];
        column.numbers::<Self>(&lists.value(row), cell.as_flattened_mut())?;
        Ok(cell)
    }

    fn is_finite(&self) -> bool {
        self.iter().all(Cell::is_finite)
    }
}

impl Cell for Vec<f64> {
    const TYPE: &'static str = "a list of f64";

    fn array(cells: &[&Self]) -> ArrayRef {
        let numbers = cells.iter().flat_map(|cell| cell.iter().copied());
        lists(cells, Arc::new(Float64Array::from_iter_values(numbers)))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let list = column.list::<Self>(row)?;
        let list = column.typed::<Self, _>(list.as_primitive_opt::<Float64Type>())?;
        Ok(list.values().to_vec())
    }

    fn is_finite(&self) -> bool {
        self.iter().copied().all(f64::is_finite)
    }
}

impl Cell for Vec<i64> {
    const TYPE: &'static str = "a list of i64";
    const UNIT: Option<&'static str> = i64::UNIT;

    fn array(cells: &[&Self]) -> ArrayRef {
        let numbers = cells.iter().flat_map(|cell| cell.iter().copied());
        lists(cells, Arc::new(Int64Array::from_iter_values(numbers)))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let list = column.list::<Self>(row)?;
        let list = column.typed::<Self, _>(list.as_primitive_opt::<Int64Type>())?;
        Ok(list.values().to_vec())
    }
}

impl<const N: usize> Cell for Vec<[f64; N]> {
    const TYPE: &'static str = "a list of fixed lists of f64";

    fn array(cells: &[&Self]) -> ArrayRef {
        let numbers = cells.iter().flat_map(|cell| cell.as_flattened());
        lists(cells, fixed_lists(N, numbers.copied()))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let list = column.list::<Self>(row)?;
        let list = column.typed::<Self, _>(list.as_fixed_size_list_opt())?;
        // A slice of a fixed list keeps its values' offset, so each entry is read on its own.
        (0..list.len())
            .map(|entry| {
                let mut numbers = [0.0; N];
                column.numbers::<Self>(&list.value(entry), &mut numbers)?;
                Ok(numbers)
            })
            .collect()
    }

    fn is_finite(&self) -> bool {
        self.iter().all(Cell::is_finite)
    }
}

/// In the format of [`Pose::to_array`].
impl<To, From> Cell for Pose<To, From> {
    const TYPE: &'static str = <[f64; 7]>::TYPE;

    fn array(cells: &[&Self]) -> ArrayRef {
        fixed_lists(7, cells.iter().flat_map(|cell| cell.to_array()))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        pose(column, <[f64; 7]>::read(column, row)?)
    }

    fn is_finite(&self) -> bool {
        self.to_array().is_finite()
    }
}

impl<To, From> Cell for Vec<Pose<To, From>> {
    const TYPE: &'static str = Vec::<[f64; 7]>::TYPE;

    fn array(cells: &[&Self]) -> ArrayRef {
        let poses = cells.iter().flat_map(|cell| cell.iter());
        lists(cells, fixed_lists(7, poses.flat_map(Pose::to_array)))
    }

    fn read(column: &Column<'_>, row: usize) -> Result<Self, SchemaError> {
        let poses = Vec::<[f64; 7]>::read(column, row)?.into_iter();
        poses.map(|numbers| pose(column, numbers)).collect()
    }

    fn is_finite(&self) -> bool {
        self.iter().all(Cell::is_finite)
    }
}

/// Whether a cell is null, or an entry of the list in it.
pub(super) fn is_null(array: &dyn Array, row: usize) -> bool {
    let list = array.as_list_opt::<i32>().map(|lists| lists.value(row));
    let list = list.or_else(|| Some(array.as_fixed_size_list_opt()?.value(row)));
    array.is_null(row) || list.is_some_and(|list| (0..list.len()).any(|idx| is_null(&list, idx)))
}

fn pose<To, From>(column: &Column<'_>, numbers: [f64; 7]) -> Result<Pose<To, From>, SchemaError> {
    Pose::from_array(numbers).map_err(|source| SchemaError::Pose {
        column: column.name.to_owned(),
        source,
    })
}

fn item(data_type: DataType) -> FieldRef {
    Arc::new(Field::new("item", data_type, false))
}

/// Returns the column of arrays of `size` of these numbers.
fn fixed_lists(size: usize, numbers: impl Iterator<Item = f64>) -> ArrayRef {
    let size = i32::try_from(size).unwrap_or(i32::MAX);
    let values = Float64Array::from_iter_values(numbers);
    let field = item(DataType::Float64);
    Arc::new(FixedSizeListArray::new(field, size, Arc::new(values), None))
}

/// Returns the column of lists whose entries, of all lists, are `values`.
fn lists<T>(lists: &[&Vec<T>], values: ArrayRef) -> ArrayRef {
    let field = item(values.data_type().clone());
    let offsets = OffsetBuffer::from_lengths(lists.iter().map(|list| list.len()));
    Arc::new(ListArray::new(field, offsets, values, None))
}
