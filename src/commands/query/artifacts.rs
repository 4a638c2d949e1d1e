//! The tables of artifacts, from the files in the records.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsStr,
    path::{Path, PathBuf},
};

use lake::{StageTable, TableFiles};
use polars::prelude::*;

use super::tables::{FINGERPRINT, PIPELINE, RUN, STAGE, scan};

/// Opens a table as one run, or the newest, had it; `None` if none of its partitions is there.
pub(super) fn table(files: &TableFiles) -> PolarsResult<Option<LazyFrame>> {
    let frames = by_column(files).into_iter().map(|(column, stages)| {
        let made = scan(stages.iter().flat_map(|stage| stage.files.values()))?;
        let named = match stages.as_slice() {
            [stage] => made.with_columns([
                lit(stage.pipeline.as_str()).alias(PIPELINE),
                lit(stage.stage.as_str()).alias(STAGE),
            ]),
            // One scan for all of them: polars cannot count the rows of concatenated frames.
            stages => made.join(
                makers(stages)?.lazy(),
                [col(FINGERPRINT)],
                [col(FINGERPRINT)],
                JoinArgs {
                    maintain_order: MaintainOrderJoin::Left,
                    ..JoinArgs::new(JoinType::Left)
                },
            ),
        };
        Ok(named.select([
            all()
                .exclude_cols([column, FINGERPRINT, PIPELINE, STAGE])
                .as_expr(),
            col(PIPELINE),
            col(STAGE),
            col(column),
        ]))
    });
    one_below_the_other(frames.collect::<PolarsResult<_>>()?)
}

/// Opens the rows of a table from all runs, with a column `run`: the units' rows, joined to the
/// runs that had them.
pub(super) fn of_all_runs(
    files: &TableFiles,
    table: &str,
    units: LazyFrame,
) -> PolarsResult<Option<LazyFrame>> {
    let units = units.filter(col("artifact").eq(lit(table))).select([
        col(RUN),
        col(PIPELINE),
        col(STAGE),
        col(FINGERPRINT),
    ]);
    let frames = by_column(files).into_values().map(|stages| {
        // Many runs may have had the same unit.
        let paths: BTreeSet<&PathBuf> = stages
            .into_iter()
            .flat_map(|stage| stage.files.values())
            .collect();
        scan(paths)
    });
    let made = one_below_the_other(frames.collect::<PolarsResult<_>>()?)?;
    Ok(made.map(|made| {
        units.join(
            made,
            [col(FINGERPRINT)],
            [col(FINGERPRINT)],
            JoinArgs::new(JoinType::Inner),
        )
    }))
}

/// The stages of a table by the column of their partitions' keys.
fn by_column(files: &TableFiles) -> BTreeMap<&str, Vec<&StageTable>> {
    let mut stages: BTreeMap<&str, Vec<&StageTable>> = BTreeMap::new();
    for stage in &files.stages {
        stages.entry(&stage.column).or_default().push(stage);
    }
    stages
}

/// The pipeline and stage of each unit.
fn makers(stages: &[&StageTable]) -> PolarsResult<DataFrame> {
    let units = stages
        .iter()
        .flat_map(|stage| stage.files.values().map(move |file| (stage, unit_of(file))));
    let units: Vec<_> = units.collect();
    let texts =
        |of: fn(&(&&StageTable, String)) -> String| units.iter().map(of).collect::<Vec<_>>();
    df!(
        FINGERPRINT => texts(|(_, unit)| unit.clone()),
        PIPELINE => texts(|(stage, _)| stage.pipeline.clone()),
        STAGE => texts(|(stage, _)| stage.stage.to_string()),
    )
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

/// Concatenates frames; a single one is returned as it is, which is faster.
fn one_below_the_other(mut frames: Vec<LazyFrame>) -> PolarsResult<Option<LazyFrame>> {
    let last = frames.pop();
    if frames.is_empty() {
        return Ok(last);
    }
    frames.extend(last);
    concat(frames, UnionArgs::default()).map(Some)
}
