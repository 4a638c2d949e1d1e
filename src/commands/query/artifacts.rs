//! The tables of artifacts, from the files in the records.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    path::{Path, PathBuf},
};

use datafusion::{
    arrow::array::{AsArray, RecordBatch},
    scalar::ScalarValue,
};
use lake::{StageTable, TableFiles};

use super::{
    scan::{FileTable, Values},
    tables::{FINGERPRINT, PIPELINE, RUN, STAGE},
};

/// Opens a table as one run, or the newest, had it; `None` if none of its partitions is there.
pub(super) fn table(files: &TableFiles) -> anyhow::Result<Option<FileTable>> {
    let (mut paths, mut parts) = (Vec::new(), Vec::new());
    for stage in &files.stages {
        for (key, path) in &stage.files {
            let values = vec![
                value(PIPELINE, &stage.pipeline),
                value(STAGE, stage.stage.as_str()),
                value(&stage.column, key.as_str()),
            ];
            parts.push((paths.len(), values));
            paths.push(path.clone());
        }
    }
    if paths.is_empty() {
        return Ok(None);
    }
    FileTable::open(paths, parts, &[]).map(Some)
}

/// Opens the rows of a table from all runs, with a column `run`: the units' rows, joined to the
/// runs that had them.
pub(super) fn of_all_runs(
    files: &TableFiles,
    table: &str,
    units: &RecordBatch,
) -> anyhow::Result<Option<FileTable>> {
    let mut known: BTreeMap<String, (usize, &StageTable, &str)> = BTreeMap::new();
    let mut paths = Vec::new();
    for stage in &files.stages {
        for (key, path) in &stage.files {
            // Many runs may have had the same unit.
            known.entry(unit_of(path)).or_insert_with(|| {
                paths.push(path.clone());
                (paths.len() - 1, stage, key.as_str())
            });
        }
    }
    if paths.is_empty() {
        return Ok(None);
    }
    let text = |name: &str| units.column_by_name(name).map(AsArray::as_string::<i32>);
    let (Some(artifacts), Some(pipelines), Some(stages), Some(fingerprints), Some(runs)) = (
        text("artifact"),
        text(PIPELINE),
        text(STAGE),
        text(FINGERPRINT),
        units.column_by_name(RUN),
    ) else {
        anyhow::bail!("the table `units` lacks a column");
    };
    let mut parts = Vec::new();
    for row in 0..units.num_rows() {
        let fingerprint = fingerprints.value(row);
        if artifacts.value(row) != table {
            continue;
        }
        if let Some((file, stage, key)) = known.get(fingerprint) {
            let values: Values = vec![
                (RUN.to_owned(), ScalarValue::try_from_array(runs, row)?),
                value(PIPELINE, pipelines.value(row)),
                value(STAGE, stages.value(row)),
                value(FINGERPRINT, fingerprint),
                value(&stage.column, key),
            ];
            parts.push((*file, values));
        }
    }
    let first = [RUN, PIPELINE, STAGE, FINGERPRINT];
    FileTable::open(paths, parts, &first).map(Some)
}

fn value(name: &str, text: &str) -> (String, ScalarValue) {
    (name.to_owned(), ScalarValue::from(text))
}

/// The digits of the unit that made a file: its folder is named for them.
fn unit_of(file: &Path) -> String {
    let folder = file
        .parent()
        .and_then(Path::file_name)
        .and_then(OsStr::to_str);
    let digits = folder.and_then(|folder| folder.split_once('='));
    digits.map_or_else(String::new, |(_, digits)| digits.to_owned())
}

/// Opens a table of runs: in the lake each file is of one run, by its number.
pub(super) fn history(files: Vec<(Option<u64>, PathBuf)>) -> anyhow::Result<FileTable> {
    let (mut paths, mut parts) = (Vec::new(), Vec::new());
    for (run, path) in files {
        let number = run.map(|run| {
            let run = i64::try_from(run).unwrap_or(i64::MAX);
            (RUN.to_owned(), ScalarValue::from(run))
        });
        parts.push((paths.len(), number.into_iter().collect()));
        paths.push(path);
    }
    FileTable::open(paths, parts, &[])
}
