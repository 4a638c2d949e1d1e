//! Declaring a table's columns, each once: name, type, unit and meaning.
//!
//! [`columns!`] generates a struct of them with its writer, reader, schema and documentation.

mod cell;
mod reader;
mod rest;
mod words;
mod writer;

pub(crate) use cell::{Cell, Column};
pub use reader::JOINTS;
pub(crate) use reader::Reader;
pub(crate) use words::words;
pub(crate) use writer::Writer;

use crate::SchemaError;

/// A value stored in one or more columns of a row.
pub(crate) trait Row: Sized {
    /// Adds the columns of the rows.
    fn write(rows: &[&Self], to: &mut Writer);

    /// Reads the row of this index.
    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError>;
}

/// A row whose columns are declared by another struct.
pub(crate) trait Flatten: Sized {
    /// The struct of the columns.
    type Flat: Row;

    /// Returns the row as it is stored.
    fn flat(&self) -> Self::Flat;

    /// Returns the row from its stored form.
    fn from_flat(flat: Self::Flat) -> Result<Self, SchemaError>;
}

impl<T: Flatten> Row for T {
    fn write(rows: &[&Self], to: &mut Writer) {
        let flat: Vec<T::Flat> = rows.iter().map(|row| row.flat()).collect();
        to.rows(&flat);
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        Self::from_flat(Row::read(from, row)?)
    }
}

/// Declares the columns of a row, in the order of the file:
///
/// ```text
/// lift_m: f64 ["m"] => "rise of the object's origin at the end",   a field and its column
/// verdict as reason: Verdict => "`held`, or why it failed",        a column of another name
/// + rate: f64 ["1"] = Self::rate => "share that held",             a column that follows from the row
/// rest: RestingPose,                                                      a field with columns of its own
/// ```
///
/// By default counts have the unit 1 and words have none.
macro_rules! columns {
    (@name $field:ident) => { stringify!($field) };
    (@name $field:ident $column:ident) => { stringify!($column) };
    (@unit) => { None };
    (@unit $unit:literal) => { Some($unit) };
    (@doc [$($unit:literal)?] [$about:literal]) => { concat!($about $(, " (", $unit, ")")?, "\n") };
    (@doc [] []) => { "Columns of its own.\n" };
    (@write $to:ident, $cells:ident, [$($name:ident)+] [$($unit:literal)?] [$about:literal]) => {
        $to.column(columns!(@name $($name)+), columns!(@unit $($unit)?), $about, &$cells)
    };
    (@write $to:ident, $cells:ident, [$name:ident] [] []) => {
        crate::columns::Row::write(&$cells, $to)
    };
    (@read $from:ident, $row:ident, [$($name:ident)+] [$about:literal]) => {
        $from.cell(columns!(@name $($name)+), $row)?
    };
    (@read $from:ident, $row:ident, [$name:ident] []) => {
        crate::columns::Row::read($from, $row)?
    };
    (
        $(#[$meta:meta])*
        $vis:vis struct $struct:ident {
            $(
                $(#[$note:meta])*
                $field:ident $(as $column:ident)? : $type:ty $([$unit:literal])? $(=> $about:literal)?,
                $(
                    + $derived:ident : $derived_type:ty $([$derived_unit:literal])?
                    = $value:expr => $derived_about:literal,
                )*
            )*
        }
    ) => {
        $(#[$meta])*
        $vis struct $struct {
            $(
                #[doc = columns!(@doc [$($unit)?] [$($about)?])]
                $(#[$note])*
                $vis $field: $type,
            )*
        }

        impl crate::columns::Row for $struct {
            fn write(rows: &[&Self], to: &mut crate::columns::Writer) {
                $(
                    let cells: Vec<&$type> = rows.iter().map(|row| &row.$field).collect();
                    columns!(@write to, cells, [$field $($column)?] [$($unit)?] [$($about)?]);
                    $(
                        let unit = columns!(@unit $($derived_unit)?);
                        let value: fn(&Self) -> $derived_type = $value;
                        let cells: Vec<_> = rows.iter().map(|row| value(row)).collect();
                        to.computed(stringify!($derived), unit, $derived_about, &cells);
                    )*
                )*
            }

            fn read(
                from: &crate::columns::Reader<'_>,
                row: usize,
            ) -> Result<Self, crate::SchemaError> {
                Ok(Self {
                    $($field: columns!(@read from, row, [$field $($column)?] [$($about)?]),)*
                })
            }
        }
    };
}
pub(crate) use columns;
