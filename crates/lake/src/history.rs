//! The history of runs as tables: `runs`, `settings`, `units`, `artifacts` and `metrics`, one
//! partition per run.

use std::{collections::BTreeMap, fs, path::PathBuf, sync::Arc};

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray,
    TimestampNanosecondArray,
};
use arrow_schema::ArrowError;
use dataflow::{FileRef, RecordOutcome, RunRecord, RunStatus, UnitRef};
use serde_json::Value;

use crate::{
    LakeError, atomic::io_error, folder::HISTORY, lake::Lake, published, register::Run, table,
};

/// Writes the tables of a finished run, and returns their files by table.
pub(crate) fn keep(
    lake: &Lake,
    run: &Run,
    record: &RunRecord,
    units: &[(UnitRef, Arc<RecordOutcome>)],
) -> Result<BTreeMap<String, FileRef>, LakeError> {
    let mut kept = BTreeMap::new();
    let folder = Folder::make(lake)?;
    let folder = &folder.0;
    let batches = [
        runs(run, record, units),
        settings(record),
        units_table(record, units),
        artifacts(units),
        metrics(units),
    ];
    for (name, batch) in HISTORY.into_iter().zip(batches) {
        let path = lake.folder.run_table(name, run.number);
        let batch = batch.map_err(|err| LakeError::Parquet {
            action: "write",
            path: path.clone(),
            source: err.into(),
        })?;
        table::write_batch(folder, &batch)?;
        let file = lake.blobs.take(&folder.join(table::FILE))?;
        // A copy, not a link: irreplaceable files are stored twice.
        published::show_copy(lake, &lake.file(&file), &path)?;
        kept.insert(name.to_owned(), file);
    }
    Ok(kept)
}

/// The temporary folder of the tables being written, removed on drop.
struct Folder(PathBuf);

impl Folder {
    fn make(lake: &Lake) -> Result<Self, LakeError> {
        let name = format!("history-{}", crate::atomic::process_name());
        let folder = Self(lake.folder.staging().join(name));
        fs::create_dir_all(&folder.0).map_err(io_error("create", &folder.0))?;
        Ok(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Leftovers are removed by a later run.
        let _left = fs::remove_dir_all(&self.0);
    }
}

/// Rebuilds the tables of a run from its record and those of its units; returns the run with them.
pub(crate) fn make_again(lake: &Lake, mut run: Run) -> Result<Run, LakeError> {
    // Without the list of its units, its tables cannot be rebuilt.
    let Ok(refs) = lake.register.units(&run) else {
        return Ok(run);
    };
    let units = with_outcomes(lake, refs)?;
    let record = run.record.clone();
    run.history = keep(lake, &run, &record, &units)?;
    lake.register.keep(&run)?;
    Ok(run)
}

/// Units with their recorded outcomes; collected ones are left out.
pub(crate) fn with_outcomes(
    lake: &Lake,
    refs: Vec<UnitRef>,
) -> Result<Vec<(UnitRef, Arc<RecordOutcome>)>, LakeError> {
    let mut units = Vec::new();
    for unit in refs {
        if let Some(stored) = lake.records.read(&unit.fingerprint)? {
            units.push((unit, Arc::new(stored.outcome)));
        }
    }
    Ok(units)
}

fn text<'a>(values: impl Iterator<Item = &'a str>) -> ArrayRef {
    Arc::new(StringArray::from_iter_values(values))
}

fn count(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

fn runs(
    run: &Run,
    record: &RunRecord,
    units: &[(UnitRef, Arc<RecordOutcome>)],
) -> Result<RecordBatch, ArrowError> {
    let (status, message) = match &record.status {
        RunStatus::Running => ("running", None),
        RunStatus::Finished => ("finished", None),
        RunStatus::Failed { message } => ("failed", Some(message.as_str())),
        RunStatus::Interrupted => ("interrupted", None),
    };
    let n_skipped = units
        .iter()
        .filter(|(_, outcome)| matches!(**outcome, RecordOutcome::Skipped { .. }))
        .count();
    let overrides = serde_json::to_string(&record.origin.overrides).unwrap_or_default();
    let started = i64::try_from(run.started_ns).unwrap_or(i64::MAX);
    let number = |n: usize| Arc::new(Int64Array::from(vec![count(n)])) as ArrayRef;
    RecordBatch::try_from_iter_with_nullable([
        (
            "pipeline",
            text([record.pipeline.as_str()].into_iter()),
            false,
        ),
        (
            "file",
            text([&*record.origin.file.to_string_lossy()].into_iter()),
            false,
        ),
        (
            "profile",
            Arc::new(StringArray::from(vec![record.origin.profile.as_deref()])) as ArrayRef,
            true,
        ),
        ("overrides", text([overrides.as_str()].into_iter()), false),
        (
            "seed",
            Arc::new(Int64Array::from(vec![record.seed.cast_signed()])),
            false,
        ),
        ("status", text([status].into_iter()), false),
        ("message", Arc::new(StringArray::from(vec![message])), true),
        (
            "started",
            Arc::new(TimestampNanosecondArray::from(vec![started]).with_timezone("UTC")),
            false,
        ),
        (
            "seconds",
            Arc::new(Float64Array::from(vec![record.seconds])),
            false,
        ),
        ("n_units", number(units.len()), false),
        (
            "n_made_now",
            number(units.iter().filter(|(unit, _)| unit.made_now).count()),
            false,
        ),
        ("n_skipped", number(n_skipped), false),
    ])
}

fn settings(record: &RunRecord) -> Result<RecordBatch, ArrowError> {
    let mut rows = Vec::new();
    for (stage, of_stage) in &record.stages {
        let mut values = BTreeMap::new();
        flatten("", &of_stage.config, &mut values);
        rows.extend(values.into_iter().map(|(key, value)| (stage, key, value)));
    }
    RecordBatch::try_from_iter_with_nullable([
        (
            "stage",
            text(rows.iter().map(|(stage, ..)| stage.as_str())),
            false,
        ),
        (
            "key",
            text(rows.iter().map(|(_, key, _)| key.as_str())),
            false,
        ),
        (
            "value",
            Arc::new(StringArray::from_iter_values(
                rows.iter().map(|(.., value)| value.to_string()),
            )) as ArrayRef,
            false,
        ),
        (
            "number",
            Arc::new(
                rows.iter()
                    .map(|(.., value)| value.as_f64())
                    .collect::<Float64Array>(),
            ),
            true,
        ),
    ])
}

/// The values of a configuration by their dotted keys.
fn flatten(prefix: &str, value: &Value, values: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(table) => {
            for (key, value) in table {
                let key = if prefix.is_empty() {
                    key.clone()
                } else {
                    format!("{prefix}.{key}")
                };
                flatten(&key, value, values);
            }
        }
        value => {
            values.insert(prefix.to_owned(), value.clone());
        }
    }
}

fn units_table(
    record: &RunRecord,
    units: &[(UnitRef, Arc<RecordOutcome>)],
) -> Result<RecordBatch, ArrowError> {
    let pipeline = record.pipeline.as_str();
    let [stage, artifact, partition] = names(&units.iter().map(|(unit, _)| unit));
    RecordBatch::try_from_iter_with_nullable([
        ("pipeline", text(units.iter().map(|_| pipeline)), false),
        (stage.0, stage.1, false),
        (artifact.0, artifact.1, false),
        (partition.0, partition.1, false),
        (
            "fingerprint",
            Arc::new(StringArray::from_iter_values(
                units.iter().map(|(unit, _)| unit.fingerprint.to_hex()),
            )) as ArrayRef,
            false,
        ),
        (
            "result",
            text(units.iter().map(|(_, outcome)| outcome.word())),
            false,
        ),
        (
            "reason",
            Arc::new(
                units
                    .iter()
                    .map(|(_, outcome)| outcome.reason())
                    .collect::<StringArray>(),
            ),
            true,
        ),
        (
            "made_now",
            Arc::new(
                units
                    .iter()
                    .map(|(unit, _)| Some(unit.made_now))
                    .collect::<BooleanArray>(),
            ),
            false,
        ),
    ])
}

/// The columns that name a unit: its stage, its artifact and its partition.
fn names<'a>(units: &(impl Iterator<Item = &'a UnitRef> + Clone)) -> [(&'static str, ArrayRef); 3] {
    let column = |of: fn(&UnitRef) -> &str| text(units.clone().map(of));
    [
        ("stage", column(|unit| &unit.node.stage)),
        ("artifact", column(|unit| &unit.node.artifact)),
        ("partition", column(|unit| &unit.partition)),
    ]
}

/// The artifacts of units, one item per entry of one of their maps.
fn entries<'a, V>(
    units: &'a [(UnitRef, Arc<RecordOutcome>)],
    of: impl Fn(&'a RecordOutcome) -> Option<&'a BTreeMap<String, V>>,
) -> Vec<(&'a UnitRef, &'a str, &'a V)> {
    let mut rows = Vec::new();
    for (unit, outcome) in units {
        for (name, value) in of(outcome).into_iter().flatten() {
            rows.push((unit, name.as_str(), value));
        }
    }
    rows
}

fn artifacts(units: &[(UnitRef, Arc<RecordOutcome>)]) -> Result<RecordBatch, ArrowError> {
    let rows = entries(units, RecordOutcome::files);
    let [stage, artifact, partition] = names(&rows.iter().map(|(unit, ..)| *unit));
    let bytes = rows
        .iter()
        .map(|(.., file)| i64::try_from(file.size).unwrap_or(i64::MAX));
    RecordBatch::try_from_iter([
        stage,
        artifact,
        partition,
        ("file", text(rows.iter().map(|(_, name, _)| *name))),
        (
            "digest",
            Arc::new(StringArray::from_iter_values(
                rows.iter().map(|(.., file)| file.digest.to_hex()),
            )) as ArrayRef,
        ),
        ("bytes", Arc::new(Int64Array::from_iter_values(bytes))),
    ])
}

fn metrics(units: &[(UnitRef, Arc<RecordOutcome>)]) -> Result<RecordBatch, ArrowError> {
    let rows = entries(units, |outcome| match outcome {
        RecordOutcome::Made { metrics, .. } => Some(metrics),
        RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => None,
    });
    let [stage, artifact, partition] = names(&rows.iter().map(|(unit, ..)| *unit));
    RecordBatch::try_from_iter([
        stage,
        artifact,
        partition,
        ("metric", text(rows.iter().map(|(_, name, _)| *name))),
        (
            "value",
            Arc::new(Float64Array::from_iter_values(
                rows.iter().map(|(.., value)| **value),
            )) as ArrayRef,
        ),
    ])
}
