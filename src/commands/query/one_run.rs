//! The tables of artifacts as one run had them.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use dataflow::UnitRef;
use lake::{Lake, Run, table};
use polars::prelude::*;

use super::tables::{FINGERPRINT, PIPELINE, STAGE, add_column, options};
use crate::outcome::Trouble;

/// A table of a run.
pub(super) struct OfRun {
    pub(super) name: String,
    /// Its rows; `None` if none of its partitions is there.
    pub(super) frame: Option<LazyFrame>,
    /// Partitions that are no longer in the lake.
    pub(super) n_collected: usize,
}

/// Opens the tables that a run had; nothing of them is read before a question asks for it.
pub(super) fn tables(lake: &Lake, run: &Run) -> Result<Vec<OfRun>, Trouble> {
    let units = &run.record.units;
    let names: BTreeSet<&str> = units
        .iter()
        .map(|unit| unit.node.artifact.as_str())
        .collect();
    let mut tables = Vec::new();
    for name in names {
        let folder = lake.every_folder(name);
        let columns = partition_columns(&folder);
        let mut by_stage: BTreeMap<(&str, &str), Vec<PathBuf>> = BTreeMap::new();
        let mut n_collected = 0;
        for unit in units.iter().filter(|unit| unit.node.artifact == name) {
            let found = columns.iter().find_map(|column| {
                let path = part(&folder, column, unit);
                path.is_file().then_some((column.as_str(), path))
            });
            match found {
                Some((column, path)) => {
                    let paths = by_stage.entry((&unit.node.stage, column)).or_default();
                    paths.push(path);
                }
                None if lake.record(&unit.fingerprint)?.is_none() => n_collected += 1,
                // It is no table, or the item was left out.
                None => {}
            }
        }
        let frames: PolarsResult<Vec<LazyFrame>> = by_stage
            .into_iter()
            .map(|((stage, column), paths)| of_stage(&run.record.pipeline, stage, column, &paths))
            .collect();
        let failed = |err: PolarsError| Trouble::failed(err, None);
        let frames = frames.map_err(failed)?;
        let frame = if frames.is_empty() {
            None
        } else {
            Some(concat(frames, UnionArgs::default()).map_err(failed)?)
        };
        tables.push(OfRun {
            name: name.to_owned(),
            frame,
            n_collected,
        });
    }
    Ok(tables)
}

/// Where the table of a unit is shown.
fn part(folder: &Path, column: &str, unit: &UnitRef) -> PathBuf {
    folder
        .join(format!("{column}={}", unit.partition))
        .join(format!("{FINGERPRINT}={}", unit.fingerprint))
        .join(table::FILE)
}

/// The columns for which the folders of partitions are named.
fn partition_columns(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let columns = entries.filter_map(|entry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        name.split_once('=').map(|(column, _)| column.to_owned())
    });
    columns.collect()
}

/// What a stage made, with the columns that its newest partitions have.
fn of_stage(
    pipeline: &str,
    stage: &str,
    column: &str,
    paths: &[PathBuf],
) -> PolarsResult<LazyFrame> {
    let mut columns = Schema::default();
    for folder in paths.iter().flat_map(|path| path.iter()) {
        if let Some(folder) = folder.to_str() {
            add_column(folder, &mut columns);
        }
    }
    let files = paths
        .iter()
        .map(|path| PlRefPath::new(path.to_string_lossy()));
    let made = LazyFrame::scan_parquet_files(files.collect(), options(columns))?;
    Ok(made.select([
        all().exclude_cols([column, FINGERPRINT]).as_expr(),
        lit(pipeline).alias(PIPELINE),
        lit(stage).alias(STAGE),
        col(column),
    ]))
}
