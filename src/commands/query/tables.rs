//! The lake's tables, under the names by which questions call them.

use std::path::{Path, PathBuf};

use lake::Lake;
use polars::{prelude::*, sql::SQLContext};

use super::faults;
use crate::outcome::Trouble;

/// What stands before a table's name to mean the rows of all runs.
const ALL: &str = "all_";

/// The lake's tables, ready to be asked.
pub(super) struct Tables {
    known: Vec<(String, LazyFrame)>,
    context: SQLContext,
}

impl Tables {
    /// Opens every table; nothing of it is read before a question asks for it. Tables of all runs
    /// are many files, and are opened only where `sql` names one.
    pub(super) fn open(lake: &Lake, sql: &str) -> Result<Self, Trouble> {
        let mut tables = Self {
            known: Vec::new(),
            context: SQLContext::new(),
        };
        for (name, folder) in folders(lake)? {
            let frame = scan(&folder).map_err(|err| Trouble::failed(err, None))?;
            tables.context.register(&name, frame.clone());
            tables.known.push((name, frame));
        }
        tables.open_all_runs(lake, sql)?;
        if tables.known.is_empty() {
            return Err(Trouble::usage(
                format!("no tables in the lake `{}`", lake.root().display()),
                "make some with `pipeline run pipelines/cgf.toml`, or name another lake with `--lake DIR`",
            ));
        }
        Ok(tables)
    }

    /// Opens the tables of all runs that a question names.
    fn open_all_runs(&mut self, lake: &Lake, sql: &str) -> Result<(), Trouble> {
        let units = self.known.iter().find(|(name, _)| name == "units");
        let Some((_, units)) = units.cloned() else {
            return Ok(());
        };
        for table in lake.tables()? {
            let name = format!("{ALL}{table}");
            if sql.contains(&name) && lake.every_folder(&table).is_dir() {
                let frame =
                    of_all_runs(lake, &table, &units).map_err(|err| Trouble::failed(err, None))?;
                self.context.register(&name, frame.clone());
                self.known.push((name, frame));
            }
        }
        Ok(())
    }

    /// Answers one question.
    pub(super) fn answer(mut self, sql: &str) -> Result<DataFrame, Trouble> {
        let answer = self.context.execute(sql).and_then(LazyFrame::collect);
        answer.map_err(|err| faults::explain(&err, sql, &self.known))
    }
}

/// The folder of each table: of the newest run that made it, and of what runs did.
fn folders(lake: &Lake) -> Result<Vec<(String, PathBuf)>, Trouble> {
    let newest = lake.newest_tables()?.into_iter();
    let newest = newest.map(|newest| (newest.table, newest.folder));
    Ok(newest.chain(lake.history_tables()?).collect())
}

/// Every row that any run made of a table, by `run`: what units made, joined to the runs that had
/// them.
fn of_all_runs(lake: &Lake, table: &str, units: &LazyFrame) -> PolarsResult<LazyFrame> {
    let units = units
        .clone()
        .filter(col("artifact").eq(lit(table)))
        .select([
            col("run"),
            col("pipeline"),
            col("stage"),
            col("fingerprint"),
        ]);
    let made = scan(&lake.every_folder(table))?;
    Ok(units.join(
        made,
        [col("fingerprint")],
        [col("fingerprint")],
        JoinArgs::new(JoinType::Inner),
    ))
}

/// Opens a folder of Parquet files; the names of folders below it are columns.
fn scan(folder: &Path) -> PolarsResult<LazyFrame> {
    let pattern = format!("{}/**/*.parquet", folder.display());
    let options = ScanArgsParquet {
        hive_options: HiveOptions::new_enabled(),
        // Older runs may have made tables with fewer columns.
        allow_missing_columns: true,
        ..ScanArgsParquet::default()
    };
    LazyFrame::scan_parquet(PlRefPath::new(pattern), options)
}
