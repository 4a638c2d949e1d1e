//! Lakes: their tables as Arrow.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use ::lake::ReadArtifact;
use ::pipeline::{Direction, LineageOf, Wanted};
use arrow_array::{
    Array as _, RecordBatch, RecordBatchIterator, RecordBatchReader, cast::AsArray,
    ffi_stream::FFI_ArrowArrayStream, types::Float64Type,
};
use arrow_schema::DataType;
use dataflow::{Artifact, BoxedDiagnostic};
use pyo3::{
    prelude::*,
    types::{PyAny, PyCapsule, PyDict},
};
use schemas::{Table as _, checkpoint};

use crate::{
    arrays::{Array, vector},
    candidates::Candidates,
    error::{failed, wrong},
    function::{self, Function},
    object::Object,
    options,
    recording::Recording,
    run::{self, Given},
};

/// A lake: the tables that pipelines made in a folder.
///
/// `path` is the folder, `data/lake` in a project.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Lake {
    path: PathBuf,
}

#[pymethods]
impl Lake {
    /// Names a lake; it is opened by each query.
    #[new]
    fn new(path: PathBuf) -> Self {
        Self { path }
    }

    /// Answers a question in SQL over the lake's tables, as `pipeline query` does.
    ///
    /// Each table is that of the newest run that made it, or of `run`, the name of a run as `pipeline runs` prints it.
    /// `show tables` lists the tables.
    #[pyo3(signature = (sql, *, run=None))]
    fn query(&self, py: Python<'_>, sql: &str, run: Option<&str>) -> PyResult<Table> {
        let answered = py.detach(|| pipeline::query(&self.path, sql, run));
        answered.map(Table).map_err(|err| options::refused(&err))
    }

    /// Runs a pipeline file, reusing every result that is still valid, as `pipeline run` does, and returns whether no item
    /// was skipped.
    ///
    /// `set` replaces values of the file, e.g. `{"train.training.epochs": 20}`; `until` is the last stage to run. `progress` is called with each event of the run,
    /// a dict with its kind as `event`. The run is a process of its own; Ctrl-C ends it, and what was made before is kept.
    #[pyo3(signature = (file, *, set=None, profile=None, until=None, jobs=None, progress=None))]
    #[expect(
        clippy::too_many_arguments,
        clippy::needless_pass_by_value,
        reason = "they are Python's, with names"
    )]
    fn run(
        &self,
        py: Python<'_>,
        file: PathBuf,
        set: Option<&Bound<'_, PyDict>>,
        profile: Option<&str>,
        until: Option<&str>,
        jobs: Option<u16>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<bool> {
        let given = Given {
            file: &file,
            set,
            profile,
            until,
            jobs,
        };
        run::run(py, &self.path, &given, progress)
    }

    /// Reads an object, with the resting poses in which it was seen.
    ///
    /// It is that of the newest run that made objects, or of `run`; `stage` names the stage if several made objects.
    #[pyo3(signature = (name, *, stage=None, run=None))]
    fn object(
        &self,
        py: Python<'_>,
        name: &str,
        stage: Option<&str>,
        run: Option<&str>,
    ) -> PyResult<Object> {
        let wanted = Wanted {
            artifact: schemas::objects::Object::NAME,
            stage,
            partition: Some(name),
            run,
        };
        let object: schemas::objects::Object =
            self.one(py, &wanted, |artifact| Ok(::lake::table::read(artifact)?))?;
        Ok(object.into())
    }

    /// Reads the motions to an object that a stage made, such as "sample" or "refine": of the newest run that made some, or
    /// of `run`.
    #[pyo3(signature = (object, *, stage=None, run=None))]
    fn candidates(
        &self,
        py: Python<'_>,
        object: &str,
        stage: Option<&str>,
        run: Option<&str>,
    ) -> PyResult<Candidates> {
        let wanted = Wanted {
            artifact: schemas::candidates::Candidates::NAME,
            stage,
            partition: Some(object),
            run,
        };
        let motions: schemas::candidates::Candidates =
            self.one(py, &wanted, |artifact| Ok(::lake::table::read(artifact)?))?;
        Ok(motions.into())
    }

    /// Loads the function of the newest run that trained one, or of `run`; `epoch` is "last" or "best".
    #[pyo3(signature = (*, epoch="last", stage=None, run=None))]
    fn function(
        &self,
        py: Python<'_>,
        epoch: &str,
        stage: Option<&str>,
        run: Option<&str>,
    ) -> PyResult<Function> {
        let files = function::files(epoch)?;
        let wanted = Wanted {
            artifact: checkpoint::NAME,
            stage,
            partition: None,
            run,
        };
        // Read while the artifact is kept.
        self.one(py, &wanted, |artifact| {
            let weights = artifact.path(files.weights)?;
            Ok(Function::read(weights, artifact.path(files.description)?))
        })?
    }

    /// Opens the recordings of an artifact, one after another: "demonstrations", "trajectories", "rollouts" or "executions",
    /// of the newest run that made some, or of `run`; of one `partition`, such as an object's name, or of all.
    #[pyo3(signature = (artifact, *, partition=None, stage=None, run=None))]
    fn recordings(
        &self,
        py: Python<'_>,
        artifact: &str,
        partition: Option<&str>,
        stage: Option<&str>,
        run: Option<&str>,
    ) -> PyResult<Recordings> {
        let wanted = Wanted {
            artifact,
            stage,
            partition,
            run,
        };
        let found = self.all(py, &wanted, |artifact| {
            let files = artifact.files.iter();
            let is_recording =
                |name: &str| Path::new(name).extension().is_some_and(|end| end == "mcap");
            let recordings = files.filter(|(name, _)| is_recording(name));
            Ok(recordings
                .map(|(_, path)| path.clone())
                .collect::<Vec<PathBuf>>())
        })?;
        let paths: Vec<PathBuf> = found.into_iter().flatten().collect();
        Ok(Recordings(Mutex::new(paths.into_iter())))
    }

    /// The lineage of an artifact, such as "screen.rollouts", and of its `partition` alone if that is given: a dict as
    /// `pipeline lineage --format json` writes it. With `down` it is what was made of it, instead of what it was made of.
    #[pyo3(signature = (artifact, partition=None, *, down=false, run=None))]
    fn lineage<'py>(
        &self,
        py: Python<'py>,
        artifact: &str,
        partition: Option<&str>,
        down: bool,
        run: Option<&str>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let of = LineageOf {
            artifact,
            partition,
            direction: if down { Direction::Down } else { Direction::Up },
            run,
        };
        let found = py.detach(|| pipeline::lineage(&self.path, &of));
        let json = found.map_err(|err| options::refused(&err))?.to_string();
        py.import("json")?.call_method1("loads", (json,))
    }

    fn __repr__(&self) -> String {
        format!("<pipeline.Lake `{}`>", self.path.display())
    }
}

impl Lake {
    /// Reads artifacts.
    fn all<T: Send>(
        &self,
        py: Python<'_>,
        wanted: &Wanted<'_>,
        read: impl FnMut(&Artifact) -> Result<T, BoxedDiagnostic> + Send,
    ) -> PyResult<Vec<T>> {
        let found = py.detach(|| pipeline::read_artifacts(&self.path, wanted, read));
        found.map_err(|err| options::refused(&err))
    }

    /// Reads the first of the artifacts.
    fn one<T: Send>(
        &self,
        py: Python<'_>,
        wanted: &Wanted<'_>,
        read: impl FnMut(&Artifact) -> Result<T, BoxedDiagnostic> + Send,
    ) -> PyResult<T> {
        let first = self.all(py, wanted, read)?.into_iter().next();
        first.ok_or_else(|| {
            wrong(
                format!("no `{}` of that run is kept", wanted.artifact),
                "run the pipeline again",
            )
        })
    }
}

/// An iterator over recordings; each is opened when its turn comes.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Recordings(Mutex<std::vec::IntoIter<PathBuf>>);

#[pymethods]
impl Recordings {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Recording>> {
        let next = self.left().next();
        next.map(|path| Recording::new(py, path)).transpose()
    }

    fn __len__(&self) -> usize {
        self.left().len()
    }
}

impl Recordings {
    fn left(&self) -> MutexGuard<'_, std::vec::IntoIter<PathBuf>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Rows of a table in Arrow's memory, which pyarrow, polars, pandas and DuckDB take over without a copy:
/// `pyarrow.table(rows)`, `polars.DataFrame(rows)`.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Table(RecordBatch);

#[pymethods]
impl Table {
    /// The names of the columns.
    #[getter]
    fn column_names(&self) -> Vec<String> {
        let schema = self.0.schema();
        schema
            .fields()
            .iter()
            .map(|field| field.name().clone())
            .collect()
    }

    /// A column as a numpy array `(n,)`: numbers as float64 (whole ones above 2⁵³ are rounded), where nulls are nan, truths
    /// without nulls as bool, texts as objects, where nulls are None.
    fn column<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Array<'py>> {
        let column = self.0.column_by_name(name).ok_or_else(|| {
            wrong(
                format!("there is no column `{name}`"),
                "`column_names` lists the columns",
            )
        })?;
        let kind = column.data_type();
        let cast = |to| arrow_cast::cast(column, to).map_err(|err| failed(&err, None));
        if matches!(
            kind,
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View
        ) {
            let texts = cast(&DataType::Utf8)?;
            let texts: Vec<Option<&str>> = texts.as_string::<i32>().iter().collect();
            return py.import("numpy")?.call_method1("array", (texts, "object"));
        }
        let is_truth = *kind == DataType::Boolean;
        if !kind.is_numeric() && !is_truth {
            return Err(wrong(
                format!("the column `{name}` is of type {kind}"),
                "take the whole table over, e.g. `polars.DataFrame(rows)`",
            ));
        }
        let numbers = cast(&DataType::Float64)?;
        let numbers = numbers.as_primitive::<Float64Type>().iter();
        let numbers = numbers.map(|number| number.unwrap_or(f64::NAN));
        let numbers = vector(py, &numbers.collect::<Vec<_>>())?;
        if is_truth && column.null_count() == 0 {
            return numbers.call_method1("astype", ("bool",));
        }
        Ok(numbers)
    }

    /// The rows as a stream of Arrow's C interface, in a capsule of Arrow's `PyCapsule` protocol.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        #[expect(
            unused_variables,
            reason = "a consumer casts itself, as the protocol allows"
        )]
        requested_schema: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let rows = RecordBatchIterator::new([Ok(self.0.clone())], self.0.schema());
        let rows: Box<dyn RecordBatchReader + Send> = Box::new(rows);
        PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(rows), c"arrow_array_stream")
    }

    fn __len__(&self) -> usize {
        self.0.num_rows()
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Table, {} rows of {}>",
            self.0.num_rows(),
            self.column_names().join(", ")
        )
    }
}
