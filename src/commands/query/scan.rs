//! A table of files: exactly these, with the values that the lake's records know of each.
//!
//! No path is read as a pattern, and no folder's name as a value.

use std::{
    mem,
    path::PathBuf,
    process, result,
    sync::{Arc, Mutex, PoisonError},
};

use async_trait::async_trait;
use datafusion::{
    arrow::{
        array::{ArrayRef, AsArray, RecordBatch, RecordBatchOptions, new_null_array},
        compute::{CastOptions, cast_with_options, concat_batches, unary},
        datatypes::{DataType, Field, Float32Type, Float64Type, Schema, SchemaRef},
    },
    catalog::{Session, TableProvider},
    common::{DataFusionError, Result},
    datasource::memory::MemorySourceConfig,
    logical_expr::{Expr, TableType},
    physical_plan::ExecutionPlan,
    scalar::ScalarValue,
};
use lake::{LakeError, TableFile};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder, prelude::*};

use super::{arithmetic, meaning::refused};

/// Values that all rows of a part have.
pub(super) type Values = Vec<(String, ScalarValue)>;

/// The rows of a file, with the values of the part.
#[derive(Debug)]
struct Part {
    file: usize,
    values: Values,
}

/// A table of files.
#[derive(Debug)]
pub(super) struct FileTable {
    files: Vec<TableFile>,
    parts: Vec<Part>,
    /// Rows that have been read from a file of another form.
    rows: Option<RecordBatch>,
    schema: SchemaRef,
}

impl FileTable {
    /// Returns a table of rows that have been read.
    pub(super) fn of_rows(rows: RecordBatch) -> Self {
        Self {
            files: Vec::new(),
            parts: Vec::new(),
            schema: rows.schema(),
            rows: Some(rows),
        }
    }

    /// Opens the files of a table: each part is a file, by its place among them, and values for its rows, which
    /// stand before (`first`) or after the columns of the files.
    pub(super) fn open(
        files: Vec<PathBuf>,
        parts: Vec<(usize, Values)>,
        first: &[&str],
    ) -> Result<Self, anyhow::Error> {
        let open = || files.into_par_iter().map(TableFile::open);
        let files: Vec<TableFile> =
            in_threads(|| open().collect::<result::Result<_, LakeError>>())??;
        let parts: Vec<Part> = parts
            .into_iter()
            .map(|(file, values)| Part { file, values })
            .collect();
        let mut columns = Columns::default();
        let mut given = Columns::default();
        for part in &parts {
            for (name, value) in &part.values {
                given.add(name, &value.data_type())?;
            }
        }
        for name in first {
            columns.0.extend(given.take(name));
        }
        let mut own = Columns::default();
        for file in &files {
            for field in file.schema().fields() {
                if !columns.has(field.name()) && !given.has(field.name()) {
                    own.add(field.name(), &kind(field.data_type()))?;
                }
            }
        }
        let all = columns.0.into_iter().chain(own.0).chain(given.0);
        let fields = all.map(|(name, kind)| Field::new(name, kind, true));
        Ok(Self {
            files,
            parts,
            rows: None,
            schema: Arc::new(Schema::new(fields.collect::<Vec<_>>())),
        })
    }

    /// Reads all rows.
    pub(super) fn rows(&self) -> Result<RecordBatch> {
        let batches = self.read(&self.schema)?;
        Ok(concat_batches(&self.schema, &batches)?)
    }

    /// Reads columns of all parts.
    fn read(&self, schema: &SchemaRef) -> Result<Vec<RecordBatch>> {
        if let Some(rows) = &self.rows {
            return Ok(vec![completed(rows, &Vec::new(), schema)?]);
        }
        let read = || self.files.par_iter().map(|file| columns_of(file, schema));
        let read: Vec<RecordBatch> = in_threads(|| read().collect::<Result<_>>())
            .map_err(|err| DataFusionError::External(err.into()))??;
        let batches = self.parts.iter().filter_map(|part| {
            let rows = read.get(part.file)?;
            (rows.num_rows() > 0).then(|| completed(rows, &part.values, schema))
        });
        batches.collect()
    }
}

/// Computes in threads of this process: those of a process that it was forked from are not in it.
fn in_threads<T: Send>(
    compute: impl FnOnce() -> T + Send,
) -> result::Result<T, ThreadPoolBuildError> {
    /// The threads, and the process whose they are.
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let pool = {
        let mut made = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        match &*made {
            Some((process, pool)) if *process == process::id() => Arc::clone(pool),
            _ => {
                let pool = Arc::new(ThreadPoolBuilder::new().build()?);
                // Dropped, threads that are not in this process would be waited for.
                mem::forget(made.replace((process::id(), Arc::clone(&pool))));
                pool
            }
        }
    };
    Ok(pool.install(compute))
}

#[async_trait]
impl TableProvider for FileTable {
    fn schema(&self) -> SchemaRef {
        self.schema.clone()
    }

    fn table_type(&self) -> TableType {
        TableType::Base
    }

    async fn scan(
        &self,
        _state: &dyn Session,
        projection: Option<&Vec<usize>>,
        _filters: &[Expr],
        _limit: Option<usize>,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        let schema = match projection {
            Some(columns) => Arc::new(self.schema.project(columns)?),
            None => self.schema.clone(),
        };
        let rows = self.read(&schema)?;
        Ok(MemorySourceConfig::try_new_exec(&[rows], schema, None)?)
    }
}

/// Columns by name, in the order in which they were met.
#[derive(Default)]
struct Columns(Vec<(String, DataType)>);

impl Columns {
    fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(known, _)| known == name)
    }

    fn take(&mut self, name: &str) -> Option<(String, DataType)> {
        let place = self.0.iter().position(|(known, _)| known == name)?;
        Some(self.0.remove(place))
    }

    fn add(&mut self, name: &str, kind: &DataType) -> Result<()> {
        match self.0.iter_mut().find(|(known, _)| known == name) {
            None => self.0.push((name.to_owned(), kind.clone())),
            Some((_, known)) => *known = common(name, known, kind)?,
        }
        Ok(())
    }
}

/// The type of a column that has two in two files.
fn common(name: &str, one: &DataType, other: &DataType) -> Result<DataType> {
    match (one, other) {
        (one, other) if one == other => Ok(one.clone()),
        (DataType::Null, kind) | (kind, DataType::Null) => Ok(kind.clone()),
        (one, other) if one.is_numeric() && other.is_numeric() => Ok(DataType::Float64),
        _ => Err(refused(
            format!(
                "the column `{name}` has two types in the files of its table: {one} and {other}"
            ),
            "ask for one run, with `--run`",
        )),
    }
}

/// The type that a column has in questions: whole numbers have 64 bits.
fn kind(kind: &DataType) -> DataType {
    match kind {
        DataType::Decimal32(..)
        | DataType::Decimal64(..)
        | DataType::Decimal128(..)
        | DataType::Decimal256(..)
        | DataType::Float16 => DataType::Float64,
        kind if kind.is_integer() => DataType::Int64,
        DataType::LargeUtf8 | DataType::Utf8View => DataType::Utf8,
        DataType::Dictionary(_, inner) => self::kind(inner),
        DataType::FixedSizeList(item, _)
        | DataType::LargeList(item)
        | DataType::List(item)
        | DataType::ListView(item)
        | DataType::LargeListView(item) => DataType::new_list(self::kind(item.data_type()), true),
        kind => kind.clone(),
    }
}

/// Reads the columns that a file has of those asked for.
fn columns_of(file: &TableFile, schema: &SchemaRef) -> Result<RecordBatch> {
    let fields = file.schema().fields().iter().enumerate();
    let wanted = fields.filter(|(_, field)| schema.field_with_name(field.name()).is_ok());
    let places: Vec<usize> = wanted.map(|(place, _)| place).collect();
    file.read(&places)
        .map_err(|err| datafusion::error::DataFusionError::External(Box::new(err)))
}

/// The rows of a part in the types that questions know.
fn completed(rows: &RecordBatch, values: &Values, schema: &SchemaRef) -> Result<RecordBatch> {
    let n_rows = rows.num_rows();
    let columns = schema.fields().iter().map(|field| {
        let kind = field.data_type();
        if let Some((_, value)) = values.iter().find(|(name, _)| name == field.name()) {
            return value.cast_to(kind)?.to_array_of_size(n_rows);
        }
        match rows.column_by_name(field.name()) {
            Some(column) => plain(column, kind),
            None => Ok(new_null_array(kind, n_rows)),
        }
    });
    let columns = columns.collect::<Result<Vec<_>>>()?;
    let options = RecordBatchOptions::new().with_row_count(Some(n_rows));
    let batch = RecordBatch::try_new_with_options(schema.clone(), columns, &options)?;
    Ok(batch)
}

/// A column in a type that questions know, with one zero and one NaN.
fn plain(column: &ArrayRef, kind: &DataType) -> Result<ArrayRef> {
    let options = CastOptions {
        safe: false,
        ..CastOptions::default()
    };
    let column = cast_with_options(column, kind, &options)?;
    Ok(match kind {
        DataType::Float64 => {
            let values = column.as_primitive::<Float64Type>();
            Arc::new(unary::<_, _, Float64Type>(values, arithmetic::plain))
        }
        DataType::Float32 => {
            let values = column.as_primitive::<Float32Type>();
            Arc::new(unary::<_, _, Float32Type>(values, |value| value + 0.0))
        }
        _ => column,
    })
}
