//! The lake's tables, under the names by which questions call them.

use std::path::{Path, PathBuf};

use lake::Lake;
use polars::{prelude::*, sql::SQLContext};

use super::faults;
use crate::outcome::Trouble;

/// The lake's tables, ready to be asked.
pub(super) struct Tables {
    known: Vec<(String, LazyFrame)>,
    context: SQLContext,
}

impl Tables {
    /// Opens every table; nothing of it is read before a question asks for it.
    pub(super) fn open(lake: &Lake) -> Result<Self, Trouble> {
        let mut tables = Self {
            known: Vec::new(),
            context: SQLContext::new(),
        };
        for (name, folder) in folders(lake)? {
            let frame = scan(&folder).map_err(|err| Trouble::failed(err, None))?;
            tables.context.register(&name, frame.clone());
            tables.known.push((name, frame));
        }
        if tables.known.is_empty() {
            return Err(Trouble::usage(
                format!("no tables in the lake `{}`", lake.root().display()),
                "make some with `pipeline run pipelines/cgf.toml`, or name another lake with `--lake DIR`",
            ));
        }
        Ok(tables)
    }

    /// Answers one question.
    pub(super) fn answer(mut self, sql: &str) -> Result<DataFrame, Trouble> {
        let answer = self.context.execute(sql).and_then(LazyFrame::collect);
        answer.map_err(|err| faults::explain(&err, sql, &self.known))
    }
}

/// The folder of each table: of the newest run's pipeline, or of all where no run is recorded.
fn folders(lake: &Lake) -> Result<Vec<(String, PathBuf)>, Trouble> {
    let run = lake.newest_run()?;
    let mut folders = Vec::new();
    for name in lake.tables()? {
        let folder = match &run {
            Some((_, run)) => lake.table_folder(&name, &run.pipeline),
            None => lake.root().join("tables").join(&name),
        };
        if folder.is_dir() {
            folders.push((name, folder));
        }
    }
    Ok(folders)
}

/// Opens a folder of Parquet files; the names of folders below it are columns.
fn scan(folder: &Path) -> PolarsResult<LazyFrame> {
    let pattern = format!("{}/**/*.parquet", folder.display());
    let options = ScanArgsParquet {
        hive_options: HiveOptions::new_enabled(),
        ..ScanArgsParquet::default()
    };
    LazyFrame::scan_parquet(PlRefPath::new(pattern), options)
}
