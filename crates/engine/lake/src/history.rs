//! The history of runs as tables: `runs`, `settings`, `units`, `artifacts` and `metrics`, one
//! partition per run.

use std::{collections::BTreeMap, sync::Arc};

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray,
    TimestampNanosecondArray,
};
use arrow_schema::ArrowError;
use dataflow::{FileRef, RecordOutcome, RunRecord, RunStatus, UnitRef};
use serde_json::Value;

use crate::{
    LakeError, folder::HISTORY, lake::Lake, published, register::Run, scratch::Scratch, table,
};

/// Writes the tables of a finished run, and returns their files by table.
pub(crate) fn keep(
    lake: &Lake,
    run: &Run,
    record: &RunRecord,
    units: &[(UnitRef, Arc<RecordOutcome>)],
) -> Result<BTreeMap<String, FileRef>, LakeError> {
    let mut kept = BTreeMap::new();
    let folder = Scratch::make(lake)?;
    for (name, batch) in HISTORY.into_iter().zip(tables(run, record, units)) {
        let path = lake.folder.run_table(name, run.number);
        let batch = batch.map_err(LakeError::parquet("write", &path))?;
        table::write_batch(folder.path(), &batch)?;
        let file = lake.blobs.take(&folder.path().join(table::FILE))?;
        // A copy, not a link: irreplaceable files are stored twice.
        published::copy_file(lake, &lake.file(&file), &path)?;
        kept.insert(name.to_owned(), file);
    }
    Ok(kept)
}

/// The rows of a run in each of the tables, in the order of their names.
pub(crate) fn tables(
    run: &Run,
    record: &RunRecord,
    units: &[(UnitRef, Arc<RecordOutcome>)],
) -> [Result<RecordBatch, ArrowError>; 5] {
    [
        runs(run, record, units),
        settings(record),
        units_table(record, units),
        artifacts(units),
        metrics(units),
    ]
}

/// Rebuilds the tables of a run from its record and those of its units; returns the run with them.
pub(crate) fn rebuild(lake: &Lake, mut run: Run) -> Result<Run, LakeError> {
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

/// A column: its name, its cells, and whether a cell may be null.
type Column = (&'static str, ArrayRef, bool);

fn text<T: AsRef<str>>(name: &'static str, cells: impl IntoIterator<Item = T>) -> Column {
    let cells = StringArray::from_iter_values(cells);
    (name, Arc::new(cells), false)
}

fn optional_text<'a>(
    name: &'static str,
    cells: impl IntoIterator<Item = Option<&'a str>>,
) -> Column {
    let cells: StringArray = cells.into_iter().collect();
    (name, Arc::new(cells), true)
}

fn int(name: &'static str, cells: impl IntoIterator<Item = i64>) -> Column {
    (name, Arc::new(Int64Array::from_iter_values(cells)), false)
}

fn float(name: &'static str, cells: impl IntoIterator<Item = f64>) -> Column {
    let cells = Float64Array::from_iter_values(cells);
    (name, Arc::new(cells), false)
}

/// A number that no table can exceed in practice.
fn saturated(number: impl TryInto<i64>) -> i64 {
    number.try_into().unwrap_or(i64::MAX)
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
    let is_skipped = |outcome: &RecordOutcome| matches!(outcome, RecordOutcome::Skipped { .. });
    let n_skipped = units.iter().filter(|(_, outcome)| is_skipped(outcome));
    let n_made_now = units.iter().filter(|(unit, _)| unit.made_now);
    let overrides = serde_json::to_string(&record.origin.overrides).unwrap_or_default();
    let started = TimestampNanosecondArray::from(vec![saturated(run.started_ns)]);
    RecordBatch::try_from_iter_with_nullable([
        text("pipeline", [&record.pipeline]),
        text("file", [record.origin.file.to_string_lossy()]),
        optional_text("profile", [record.origin.profile.as_deref()]),
        text("overrides", [overrides]),
        int("seed", [record.seed.cast_signed()]),
        text("status", [status]),
        optional_text("message", [message]),
        ("started", Arc::new(started.with_timezone("UTC")), false),
        float("seconds", [record.seconds]),
        int("n_units", [saturated(units.len())]),
        int("n_made_now", [saturated(n_made_now.count())]),
        int("n_skipped", [saturated(n_skipped.count())]),
    ])
}

fn settings(record: &RunRecord) -> Result<RecordBatch, ArrowError> {
    let mut rows = Vec::new();
    for (stage, of_stage) in &record.stages {
        let mut values = BTreeMap::new();
        flatten("", &of_stage.config, &mut values);
        rows.extend(values.into_iter().map(|(key, value)| (stage, key, value)));
    }
    let numbers = rows.iter().map(|(.., value)| value.as_f64());
    RecordBatch::try_from_iter_with_nullable([
        text("stage", rows.iter().map(|(stage, ..)| stage.as_str())),
        text("key", rows.iter().map(|(_, key, _)| key)),
        text("value", rows.iter().map(|(.., value)| value.to_string())),
        ("number", Arc::new(numbers.collect::<Float64Array>()), true),
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
    let [stage, artifact, partition] = names(&units.iter().map(|(unit, _)| unit));
    let made_now = units.iter().map(|(unit, _)| Some(unit.made_now));
    let fingerprints = units.iter().map(|(unit, _)| unit.fingerprint.to_hex());
    RecordBatch::try_from_iter_with_nullable([
        text("pipeline", units.iter().map(|_| &record.pipeline)),
        stage,
        artifact,
        partition,
        text("fingerprint", fingerprints),
        text("result", units.iter().map(|(_, outcome)| outcome.word())),
        optional_text("reason", units.iter().map(|(_, outcome)| outcome.reason())),
        (
            "made_now",
            Arc::new(made_now.collect::<BooleanArray>()),
            false,
        ),
    ])
}

/// The columns that name a unit: its stage, its artifact and its partition.
fn names<'a>(units: &(impl Iterator<Item = &'a UnitRef> + Clone)) -> [Column; 3] {
    [
        text("stage", units.clone().map(|unit| unit.node.stage.as_str())),
        text(
            "artifact",
            units.clone().map(|unit| unit.node.artifact.as_str()),
        ),
        text(
            "partition",
            units.clone().map(|unit| unit.partition.as_str()),
        ),
    ]
}

/// The artifacts of units, one item per entry of one of their maps.
fn entries<'a, K: ToString + 'a, V>(
    units: &'a [(UnitRef, Arc<RecordOutcome>)],
    of: impl Fn(&'a RecordOutcome) -> Option<&'a BTreeMap<K, V>>,
) -> Vec<(&'a UnitRef, String, &'a V)> {
    let mut rows = Vec::new();
    for (unit, outcome) in units {
        for (name, value) in of(outcome).into_iter().flatten() {
            rows.push((unit, name.to_string(), value));
        }
    }
    rows
}

fn artifacts(units: &[(UnitRef, Arc<RecordOutcome>)]) -> Result<RecordBatch, ArrowError> {
    let rows = entries(units, RecordOutcome::files);
    let [stage, artifact, partition] = names(&rows.iter().map(|(unit, ..)| *unit));
    RecordBatch::try_from_iter_with_nullable([
        stage,
        artifact,
        partition,
        text("file", rows.iter().map(|(_, name, _)| name)),
        text("digest", rows.iter().map(|(.., file)| file.digest.to_hex())),
        int("bytes", rows.iter().map(|(.., file)| saturated(file.size))),
    ])
}

fn metrics(units: &[(UnitRef, Arc<RecordOutcome>)]) -> Result<RecordBatch, ArrowError> {
    let rows = entries(units, |outcome| match outcome {
        RecordOutcome::Made { metrics, .. } => Some(metrics),
        RecordOutcome::Skipped { .. } | RecordOutcome::Filtered { .. } => None,
    });
    let [stage, artifact, partition] = names(&rows.iter().map(|(unit, ..)| *unit));
    RecordBatch::try_from_iter_with_nullable([
        stage,
        artifact,
        partition,
        text("metric", rows.iter().map(|(_, name, _)| name)),
        float("value", rows.iter().map(|(.., value)| **value)),
    ])
}
