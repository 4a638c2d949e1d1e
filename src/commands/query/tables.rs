//! The lake's tables, under the names by which questions call them.

use std::{fs, path::Path, sync::Arc};

use lake::{Lake, Run, table};
use polars::{prelude::*, sql::SQLContext};

use super::{faults, one_run};
use crate::outcome::Trouble;

/// What stands before a table's name to mean the rows of all runs.
const ALL: &str = "all_";

/// The columns that are the same in every table.
pub(super) const RUN: &str = "run";
pub(super) const PIPELINE: &str = "pipeline";
pub(super) const STAGE: &str = "stage";
pub(super) const FINGERPRINT: &str = "fingerprint";

/// The lake's tables, ready to be asked.
pub(super) struct Tables {
    known: Vec<(String, LazyFrame)>,
    /// Tables of which so many partitions are no longer in the lake.
    pub(super) collected: Vec<(String, usize)>,
    context: SQLContext,
}

impl Tables {
    /// Opens every table; nothing of it is read before a question asks for it. Tables of all runs
    /// are many files, and are opened only where `sql` names one.
    ///
    /// The tables of artifacts are as `run` had them, or else each as the newest run that made it.
    pub(super) fn open(lake: &Lake, sql: &str, run: Option<&Run>) -> Result<Self, Trouble> {
        let mut tables = Self {
            known: Vec::new(),
            collected: Vec::new(),
            context: SQLContext::new(),
        };
        match run {
            Some(run) => {
                for table in one_run::tables(lake, run)? {
                    check(lake, sql, &table.name, &lake.every_folder(&table.name))?;
                    if table.n_collected > 0 && sql.contains(&table.name) {
                        tables
                            .collected
                            .push((table.name.clone(), table.n_collected));
                    }
                    if let Some(frame) = table.frame {
                        tables.register(table.name, frame);
                    }
                }
            }
            None => {
                for newest in lake.newest_tables()? {
                    check(lake, sql, &newest.table, &newest.folder)?;
                    tables.register(newest.table, scan(&newest.folder).map_err(failed)?);
                }
            }
        }
        for (name, folder) in lake.history_tables()? {
            check(lake, sql, &name, &folder)?;
            tables.register(name, scan(&folder).map_err(failed)?);
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

    fn register(&mut self, name: String, frame: LazyFrame) {
        self.context.register(&name, frame.clone());
        self.known.push((name, frame));
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
                check(lake, sql, &name, &lake.every_folder(&table))?;
                let frame = of_all_runs(lake, &table, &units).map_err(failed)?;
                self.register(name, frame);
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

/// Makes sure that a table that a question names is not damaged.
fn check(lake: &Lake, sql: &str, name: &str, folder: &Path) -> Result<(), Trouble> {
    if sql.contains(name) {
        lake.check_shown(folder)?;
    }
    Ok(())
}

fn failed(err: PolarsError) -> Trouble {
    Trouble::failed(err, None)
}

/// Every row that any run made of a table, by `run`: what units made, joined to the runs that had
/// them.
fn of_all_runs(lake: &Lake, table: &str, units: &LazyFrame) -> PolarsResult<LazyFrame> {
    let units = units
        .clone()
        .filter(col("artifact").eq(lit(table)))
        .select([col(RUN), col(PIPELINE), col(STAGE), col(FINGERPRINT)]);
    let made = scan(&lake.every_folder(table))?;
    Ok(units.join(
        made,
        [col(FINGERPRINT)],
        [col(FINGERPRINT)],
        JoinArgs::new(JoinType::Inner),
    ))
}

/// Opens a folder of Parquet files; the names of folders below it are columns.
fn scan(folder: &Path) -> PolarsResult<LazyFrame> {
    let pattern = format!("{}/**/{}", folder.display(), table::FILE);
    let mut columns = Schema::default();
    name_columns(folder, &mut columns);
    // The folders above are columns as well.
    let above = folder.iter().filter_map(|name| name.to_str());
    for name in above {
        add_column(name, &mut columns);
    }
    LazyFrame::scan_parquet(PlRefPath::new(pattern), options(columns))
}

/// How files are read of which folders' names give columns.
pub(super) fn options(columns: Schema) -> ScanArgsParquet {
    ScanArgsParquet {
        hive_options: HiveOptions {
            schema: Some(Arc::new(columns)),
            ..HiveOptions::new_enabled()
        },
        // Older runs may have made tables with fewer columns.
        allow_missing_columns: true,
        ..ScanArgsParquet::default()
    }
}

/// The columns that folders below one are named for: text, so that the key `042` is not 42, except
/// for numbers of runs.
fn name_columns(folder: &Path, columns: &mut Schema) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    let mut here: Vec<String> = Vec::new();
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(column) = add_column(&name, columns) else {
            continue;
        };
        // Other partitions of a stage have no other columns.
        if [PIPELINE, STAGE].contains(&column.as_str()) || !here.contains(&column) {
            name_columns(&entry.path(), columns);
            here.push(column);
        }
    }
}

/// Adds the column for which a folder is named, and returns it.
pub(super) fn add_column(folder: &str, columns: &mut Schema) -> Option<String> {
    let (column, _) = folder.split_once('=')?;
    let kind = if column == RUN {
        DataType::Int64
    } else {
        DataType::String
    };
    columns.insert(column.into(), kind);
    Some(column.to_owned())
}
