//! Tables: one Parquet file per partition of an artifact.

use std::{collections::BTreeMap, fs::File, path::Path};

use arrow_array::RecordBatch;
use arrow_select::concat::concat_batches;
use dataflow::Artifact;
use parquet::{
    arrow::{ArrowWriter, arrow_reader::ParquetRecordBatchReaderBuilder},
    basic::{Compression, ZstdLevel},
    file::{
        metadata::{ColumnChunkMetaData, RowGroupMetaData},
        properties::WriterProperties,
    },
};
pub use schemas::TABLE_FILE as FILE;
use schemas::{
    Table,
    draws::{Draw, Draws},
};

use crate::{
    LakeError, ReadArtifact,
    atomic::{self, io_error},
};

/// Rows per row group: memory of a reader grows with this, not with the file.
const ROW_GROUP_ROWS: usize = 131_072;

/// Tables of fewer bytes are neither compressed nor dictionary-encoded: starting a compressor per
/// column, or looking for repeated values, takes longer than everything else done with them.
const COMPRESSED_BYTES: usize = 1 << 16;

/// Writes the table of the artifact in `folder`.
///
/// # Errors
///
/// Fails if a number is not finite, or the file cannot be written.
pub fn write<T: Table>(folder: &Path, table: &T) -> Result<(), LakeError> {
    let batch = table.to_batch().map_err(|source| LakeError::Rows {
        table: T::NAME,
        source,
    })?;
    write_file(&folder.join(T::FILE), &batch)
}

/// Writes columns without a schema as the table of the artifact in `folder`.
///
/// # Errors
///
/// Fails if the file cannot be written.
pub fn write_batch(folder: &Path, batch: &RecordBatch) -> Result<(), LakeError> {
    write_file(&folder.join(FILE), batch)
}

fn write_file(path: &Path, batch: &RecordBatch) -> Result<(), LakeError> {
    let file = File::create(path).map_err(io_error("write", path))?;
    let properties = WriterProperties::builder()
        .set_compression(if is_small(batch) {
            Compression::UNCOMPRESSED
        } else {
            Compression::ZSTD(ZstdLevel::default())
        })
        .set_dictionary_enabled(!is_small(batch))
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS))
        .set_created_by(concat!("pipeline ", env!("CARGO_PKG_VERSION")).to_owned())
        .build();
    let written = ArrowWriter::try_new(file, batch.schema(), Some(properties));
    let written = written.and_then(|mut writer| {
        writer.write(batch)?;
        writer.close()
    });
    written.map(drop).map_err(LakeError::parquet("write", path))
}

/// Returns whether a table is small, from its content alone.
fn is_small(batch: &RecordBatch) -> bool {
    let columns = batch.columns().iter();
    let bytes: usize = columns
        .map(|column| {
            let size = column.to_data().get_slice_memory_size();
            size.unwrap_or(COMPRESSED_BYTES)
        })
        .sum();
    bytes < COMPRESSED_BYTES
}

/// Reads the table of an artifact: where it lies beside another one, or where it is the artifact's own.
///
/// # Errors
///
/// Fails if the artifact has no table, or it is not valid Parquet or does not follow its schema.
pub fn read<T: Table>(artifact: &Artifact) -> Result<T, LakeError> {
    let is_beside = artifact.file(T::FILE).is_some();
    let batch = read_file(artifact, if is_beside { T::FILE } else { FILE })?;
    T::from_batch(artifact.key.as_str(), &batch).map_err(|source| LakeError::Schema {
        table: T::NAME,
        key: artifact.key.clone(),
        source,
    })
}

/// Reads the draws of an artifact of candidates: those in its own file, or, where its generator wrote none, one for each
/// candidate.
///
/// # Errors
///
/// Fails if the artifact has no table, or it is not valid Parquet or does not follow its schema.
pub fn read_draws(artifact: &Artifact) -> Result<Draws, LakeError> {
    if artifact.file(Draws::FILE).is_some() {
        return read(artifact);
    }
    let batch = read_file(artifact, FILE)?;
    Draw::of_candidates(&batch).map_err(|source| LakeError::Schema {
        table: Draws::NAME,
        key: artifact.key.clone(),
        source,
    })
}

/// Reads the columns of an artifact's table, whatever they are.
///
/// # Errors
///
/// Fails if the artifact has no table or it is not valid Parquet.
pub fn read_batch(artifact: &Artifact) -> Result<RecordBatch, LakeError> {
    read_file(artifact, FILE)
}

fn read_file(artifact: &Artifact, file: &str) -> Result<RecordBatch, LakeError> {
    let path = artifact.path(file)?;
    let reader = open(path)?;
    let schema = reader.schema().clone();
    let groups = reader.metadata().row_groups().iter();
    let chunks = groups.flat_map(RowGroupMetaData::columns);
    let mut codecs = chunks.map(ColumnChunkMetaData::compression);
    if let Some(codec) = codecs.find_map(unread) {
        let path = path.to_owned();
        return Err(LakeError::Compression { path, codec });
    }
    let reader = reader.build().map_err(LakeError::parquet("read", path))?;
    let batches = reader.collect::<Result<Vec<_>, _>>();
    let batches = batches.map_err(LakeError::parquet("read", path))?;
    concat_batches(&schema, &batches).map_err(LakeError::parquet("read", path))
}

/// Returns the name of a compression that is not read here: of those that others write, each would be a crate more.
fn unread(codec: Compression) -> Option<&'static str> {
    match codec {
        Compression::UNCOMPRESSED | Compression::SNAPPY | Compression::ZSTD(_) => None,
        Compression::GZIP(_) => Some("gzip"),
        Compression::LZO => Some("lzo"),
        Compression::BROTLI(_) => Some("brotli"),
        Compression::LZ4 | Compression::LZ4_RAW => Some("lz4"),
    }
}

/// Opens a table's file and reads its metadata.
fn open(path: &Path) -> Result<ParquetRecordBatchReaderBuilder<File>, LakeError> {
    let file = atomic::open(path).map_err(io_error("read", path))?;
    ParquetRecordBatchReaderBuilder::try_new(file).map_err(LakeError::parquet("read", path))
}

/// Metadata of a table's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Description {
    /// Number of rows.
    pub rows: i64,
    /// The columns in their order.
    pub columns: Vec<ColumnDescription>,
    /// The schema's metadata, e.g. the names of joints.
    pub metadata: BTreeMap<String, String>,
}

/// Metadata of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnDescription {
    /// Its name.
    pub name: String,
    /// Its Arrow type.
    pub data_type: String,
    /// The unit of its numbers, empty if it holds none.
    pub unit: String,
    /// Its meaning.
    pub description: String,
}

/// Reads a table's metadata, without its rows.
///
/// # Errors
///
/// Fails if the file is not valid Parquet.
pub fn describe(path: &Path) -> Result<Description, LakeError> {
    let reader = open(path)?;
    let columns = reader.schema().fields().iter().map(|field| {
        let note = |key: &str| field.metadata().get(key).cloned().unwrap_or_default();
        ColumnDescription {
            name: field.name().clone(),
            data_type: field.data_type().to_string(),
            unit: note("unit"),
            description: note("description"),
        }
    });
    let metadata = reader.schema().metadata().iter();
    let metadata = metadata.map(|(key, value)| (key.clone(), value.clone()));
    Ok(Description {
        rows: reader.metadata().file_metadata().num_rows(),
        columns: columns.collect(),
        metadata: metadata.collect(),
    })
}
