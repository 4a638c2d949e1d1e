//! Columns of a table's file, for readers that do not know its schema.

use std::path::PathBuf;

use arrow_array::{RecordBatch, RecordBatchOptions};
use arrow_schema::SchemaRef;
use arrow_select::concat::concat_batches;
use parquet::arrow::{
    ProjectionMask,
    arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder},
};

use crate::{
    LakeError,
    atomic::{self, io_error},
};

/// Rows that are read at once.
const ROWS: usize = 1 << 16;

/// A table's file, whose metadata has been read.
#[derive(Debug, Clone)]
pub struct TableFile {
    path: PathBuf,
    metadata: ArrowReaderMetadata,
}

impl TableFile {
    /// Opens a file.
    ///
    /// # Errors
    ///
    /// Fails if it is not valid Parquet.
    pub fn open(path: PathBuf) -> Result<Self, LakeError> {
        let file = atomic::open(&path).map_err(io_error("read", &path))?;
        let metadata = ArrowReaderMetadata::load(&file, ArrowReaderOptions::new());
        let metadata = metadata.map_err(LakeError::parquet("read", &path))?;
        Ok(Self { path, metadata })
    }

    /// Returns its columns.
    pub fn schema(&self) -> &SchemaRef {
        self.metadata.schema()
    }

    /// Reads these of its columns, by their places, in ascending order.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read or is damaged.
    pub fn read(&self, columns: &[usize]) -> Result<RecordBatch, LakeError> {
        let failed = LakeError::parquet("read", &self.path);
        let schema = self.schema().project(columns);
        let schema = schema.map_err(LakeError::parquet("read", &self.path))?;
        if columns.is_empty() {
            let rows = self.metadata.metadata().file_metadata().num_rows();
            let rows = RecordBatchOptions::new().with_row_count(usize::try_from(rows).ok());
            let empty = RecordBatch::try_new_with_options(schema.into(), Vec::new(), &rows);
            return empty.map_err(failed);
        }
        let file = atomic::open(&self.path).map_err(io_error("read", &self.path))?;
        let places = columns.iter().copied();
        let mask = ProjectionMask::roots(self.metadata.parquet_schema(), places);
        let reader =
            ParquetRecordBatchReaderBuilder::new_with_metadata(file, self.metadata.clone())
                .with_projection(mask)
                .with_batch_size(ROWS)
                .build()
                .map_err(LakeError::parquet("read", &self.path))?;
        let batches = reader.collect::<Result<Vec<_>, _>>();
        let batches = batches.map_err(LakeError::parquet("read", &self.path))?;
        concat_batches(&schema.into(), &batches).map_err(failed)
    }
}
