//! What makes a type an artifact that is a table.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::SchemaError;

/// One partition of an artifact that is a table.
///
/// `lake` writes it as Parquet and reads it back; the partition's key is its file's place, not a column.
pub trait Table: Sized {
    /// Name of the artifact, e.g. `candidates`.
    const NAME: &'static str;
    /// Name and version of its columns, e.g. `candidates/2`; readers refuse every other version.
    const VERSION: &'static str;

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
    /// Fails if the columns are of another version, or hold what the artifact cannot.
    fn from_batch(key: &str, batch: &RecordBatch) -> Result<Self, SchemaError>;
}
