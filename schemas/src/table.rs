//! The trait of artifacts that are tables.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::SchemaError;

/// Name of an artifact's table in its folder.
pub const TABLE_FILE: &str = "part.parquet";

/// One partition of an artifact that is a table.
///
/// `lake` writes it as Parquet and reads it back; the partition's key is in its file's path, not a
/// column.
pub trait Table: Sized {
    /// Name of the artifact, e.g. `candidates`.
    const NAME: &'static str;
    /// Kind of item that one partition holds, e.g. `object`: the name of the Hive partition column.
    const PARTITION: &'static str;
    /// Name and version of its columns, e.g. `candidates/3`; readers refuse every other version but those of
    /// `READ_AS`.
    const VERSION: &'static str;
    /// Name of its file in the artifact.
    const FILE: &'static str = TABLE_FILE;

    /// Returns the columns with their types, units and meanings.
    fn schema() -> Schema;

    /// Returns the partition as columns.
    ///
    /// # Errors
    ///
    /// Fails if a number is not finite.
    fn to_batch(&self) -> Result<RecordBatch, SchemaError>;

    /// Reads what [`Table::to_batch`] returned for the partition `key`.
    ///
    /// # Errors
    ///
    /// Fails if the columns are of another version or hold invalid values.
    fn from_batch(key: &str, batch: &RecordBatch) -> Result<Self, SchemaError>;
}

/// Declares a table with a name, a version and the kind of item that one partition holds. A partition has rows, or one
/// row, with the columns of `columns!`. What is beside another table is written into its artifact, as
/// `NAME.parquet`.
macro_rules! table {
    ($name:literal, $version:literal, per $partition:literal, rows: $row:ty) => {
        table! {@impl $name, $version, $partition, crate::TABLE_FILE, $row, Vec<$row>, |table| table, |reader| reader.rows()}
    };
    ($name:literal, $version:literal, per $partition:literal, rows: $row:ty, beside $other:literal) => {
        table! {@impl $name, $version, $partition, concat!($name, ".parquet"), $row, Vec<$row>, |table| table, |reader| reader.rows()}
    };
    ($name:literal, $version:literal, per $partition:literal, row: $row:ty) => {
        table! {@impl $name, $version, $partition, crate::TABLE_FILE, $row, $row, std::slice::from_ref, |reader| reader.row()}
    };
    ($name:literal, $version:literal, per $partition:literal, row: $row:ty, beside $other:literal) => {
        table! {@impl $name, $version, $partition, concat!($name, ".parquet"), $row, $row, std::slice::from_ref, |reader| reader.row()}
    };
    (@impl $name:literal, $version:literal, $partition:literal, $file:expr, $row:ty, $table:ty, $rows:expr, $read:expr) => {
        impl crate::Table for $table {
            const NAME: &'static str = $name;
            const PARTITION: &'static str = $partition;
            const VERSION: &'static str = concat!($name, "/", $version);
            const FILE: &'static str = $file;

            fn schema() -> arrow_schema::Schema {
                crate::columns::Writer::of::<$row>(Self::VERSION, &[]).schema()
            }

            fn to_batch(&self) -> Result<arrow_array::RecordBatch, crate::SchemaError> {
                let rows: fn(&Self) -> &[$row] = $rows;
                crate::columns::Writer::of(Self::VERSION, rows(self)).into_batch()
            }

            fn from_batch(
                _key: &str,
                batch: &arrow_array::RecordBatch,
            ) -> Result<Self, crate::SchemaError> {
                let reader = crate::columns::Reader::new(batch, Self::VERSION)?;
                let read: fn(&crate::columns::Reader<'_>) -> Result<Self, crate::SchemaError> =
                    $read;
                read(&reader)
            }
        }
    };
}
pub(crate) use table;
