//! Tables under their names in queries.

use std::{collections::BTreeSet, ffi::OsStr, path::PathBuf, sync::Arc};

use lake::{Lake, TableFiles};
use polars::{prelude::*, sql::SQLContext};

use super::{artifacts, faults, source::Source};
use crate::outcome::CommandError;

/// Prefix of a table's name for the rows of all runs.
const ALL: &str = "all_";

/// The columns that are the same in every table.
pub(super) const RUN: &str = "run";
pub(super) const PIPELINE: &str = "pipeline";
pub(super) const STAGE: &str = "stage";
pub(super) const FINGERPRINT: &str = "fingerprint";

/// The tables that a query names, ready for it.
pub(super) struct Tables<'a> {
    source: Source<'a>,
    known: Vec<(String, LazyFrame)>,
    /// Tables with the number of their collected partitions.
    pub(super) collected: Vec<(String, usize)>,
    context: SQLContext,
}

impl<'a> Tables<'a> {
    /// Opens the tables that `sql` names: exactly the files in the records, each of which is read
    /// once and checked against its digest.
    pub(super) fn open(source: Source<'a>, sql: &str) -> Result<Self, CommandError> {
        let mut tables = Self {
            source,
            known: Vec::new(),
            collected: Vec::new(),
            context: SQLContext::new(),
        };
        let is_in_word = |c: char| c.is_alphanumeric() || c == '_';
        let words: BTreeSet<&str> = sql.split(|c| !is_in_word(c)).collect();
        for name in tables.source.names()? {
            let name = name.as_str();
            if words.contains(name) {
                let files = tables.source.newest(name)?;
                tables.note_collected(name, &files);
                if let Some(frame) = artifacts::table(&files).map_err(failed)? {
                    tables.register(name.to_owned(), frame);
                }
            }
            let all = format!("{ALL}{name}");
            if words.contains(all.as_str()) {
                let files = tables.source.of_all_runs(name)?;
                tables.note_collected(&all, &files);
                let units = tables.history("units")?;
                if let Some(units) = units
                    && let Some(frame) =
                        artifacts::of_all_runs(&files, name, units).map_err(failed)?
                {
                    tables.register(all, frame);
                }
            }
        }
        for name in Lake::history_tables() {
            if words.contains(name)
                && let Some(frame) = tables.history(name)?
            {
                tables.register(name.to_owned(), frame);
            }
        }
        Ok(tables)
    }

    /// Opens a table of runs, if there are any.
    fn history(&mut self, name: &str) -> Result<Option<LazyFrame>, CommandError> {
        let files = self.source.history(name)?;
        if files.is_empty() {
            return Ok(None);
        }
        scan(&files).map(Some).map_err(failed)
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
        answer.map_err(|err| faults::explain(&err, sql, &mut self.source, &self.known))
    }
}

fn failed(err: PolarsError) -> CommandError {
    CommandError::failed(err, None)
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
