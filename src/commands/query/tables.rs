//! The lake's tables, under their names in queries.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsStr,
    path::PathBuf,
    sync::Arc,
};

use dataflow::ArtifactName;
use lake::{Lake, Run, TableFiles};
use polars::{prelude::*, sql::SQLContext};

use super::{artifacts, faults};
use crate::{commands::chosen, outcome::CommandError};

/// Prefix of a table's name for the rows of all runs.
const ALL: &str = "all_";

/// The columns that are the same in every table.
pub(super) const RUN: &str = "run";
pub(super) const PIPELINE: &str = "pipeline";
pub(super) const STAGE: &str = "stage";
pub(super) const FINGERPRINT: &str = "fingerprint";

/// The lake's tables, ready for a query.
pub(super) struct Tables<'a> {
    lake: &'a Lake,
    known: Vec<(String, LazyFrame)>,
    /// Tables with the number of their collected partitions.
    pub(super) collected: Vec<(String, usize)>,
    context: SQLContext,
}

impl<'a> Tables<'a> {
    /// Opens the tables that `sql` names: exactly the files in the records, each of which is read
    /// once and checked against its digest.
    ///
    /// The tables of artifacts are those of `run`, or else of the newest run that made each.
    pub(super) fn open(lake: &'a Lake, sql: &str, run: Option<&Run>) -> Result<Self, CommandError> {
        let mut tables = Self {
            lake,
            known: Vec::new(),
            collected: Vec::new(),
            context: SQLContext::new(),
        };
        let names = names(lake, run)?;
        if names.is_empty() {
            return Err(CommandError::usage(
                format!("no tables in the lake `{}`", lake.root().display()),
                format!(
                    "{}, or name another lake with `--lake DIR`",
                    chosen::begin()
                ),
            ));
        }
        let is_in_word = |c: char| c.is_alphanumeric() || c == '_';
        let words: BTreeSet<&str> = sql.split(|c| !is_in_word(c)).collect();
        for name in names {
            if words.contains(name.as_str()) {
                let files = match run {
                    Some(run) => lake.table_of_run(name.as_str(), run)?,
                    None => lake.newest_table(name.as_str())?,
                };
                tables.note_collected(name.as_str(), &files);
                if let Some(frame) = artifacts::table(&files).map_err(failed)? {
                    tables.register(name.to_string(), frame);
                }
            }
            let all = format!("{ALL}{name}");
            if words.contains(all.as_str()) {
                let files = lake.table_of_all_runs(name.as_str())?;
                tables.note_collected(&all, &files);
                let units = history(&lake.history_table("units")?).map_err(failed)?;
                if let Some(units) = units
                    && let Some(frame) =
                        artifacts::of_all_runs(&files, name.as_str(), units).map_err(failed)?
                {
                    tables.register(all, frame);
                }
            }
        }
        for name in Lake::history_tables() {
            if words.contains(name)
                && let Some(frame) = history(&lake.history_table(name)?).map_err(failed)?
            {
                tables.register(name.to_owned(), frame);
            }
        }
        Ok(tables)
    }

    fn note_collected(&mut self, name: &str, files: &TableFiles) {
        if files.n_collected > 0 {
            self.collected.push((name.to_owned(), files.n_collected));
        }
    }

    fn register(&mut self, name: String, frame: LazyFrame) {
        self.context.register(&name, frame.clone());
        self.known.push((name, frame));
    }

    /// Runs one query.
    pub(super) fn answer(mut self, sql: &str) -> Result<DataFrame, CommandError> {
        let answer = self.context.execute(sql).and_then(LazyFrame::collect);
        answer.map_err(|err| faults::explain(&err, sql, self.lake, &self.known))
    }
}

/// Names of the artifacts that may have a table.
fn names(lake: &Lake, run: Option<&Run>) -> Result<BTreeSet<ArtifactName>, CommandError> {
    let mut names = BTreeSet::new();
    let newest = if run.is_some() {
        None
    } else {
        names.extend(lake.tables()?);
        let numbers = lake.runs()?;
        let newest = numbers.last().map(|&number| lake.run_without_units(number));
        newest.transpose()?
    };
    let outputs = run.or(newest.as_ref()).map(|run| &run.record.outputs);
    names.extend(
        outputs
            .into_iter()
            .flatten()
            .map(|output| output.node.artifact.clone()),
    );
    Ok(names)
}

fn failed(err: PolarsError) -> CommandError {
    CommandError::failed(err, None)
}

/// Opens a table of runs; its column `run` comes from the folder names.
fn history(files: &BTreeMap<u64, PathBuf>) -> PolarsResult<Option<LazyFrame>> {
    if files.is_empty() {
        return Ok(None);
    }
    scan(files.values()).map(Some)
}

/// Opens files of one form; the names of the folders above them are columns.
pub(super) fn scan<'f>(files: impl IntoIterator<Item = &'f PathBuf>) -> PolarsResult<LazyFrame> {
    let mut columns = Schema::default();
    let mut paths = Vec::new();
    for path in files {
        for folder in path.iter().filter_map(OsStr::to_str) {
            add_column(folder, &mut columns);
        }
        paths.push(PlRefPath::new(path.to_string_lossy()));
    }
    let options = ScanArgsParquet {
        hive_options: HiveOptions {
            schema: Some(Arc::new(columns)),
            ..HiveOptions::new_enabled()
        },
        // Tables of older runs may have fewer columns.
        allow_missing_columns: true,
        ..ScanArgsParquet::default()
    };
    LazyFrame::scan_parquet_files(paths.into(), options)
}

/// Adds the column for which a folder is named.
///
/// Text, so that the key `042` is not 42, except for numbers of runs.
fn add_column(folder: &str, columns: &mut Schema) {
    let Some((column, _)) = folder.split_once('=') else {
        return;
    };
    let kind = if column == RUN {
        DataType::Int64
    } else {
        DataType::String
    };
    columns.insert(column.into(), kind);
}
