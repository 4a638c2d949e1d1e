//! The lake's tables as SQL views for DuckDB: `duckdb -init views.sql` from the lake's folder.

use std::path::{Path, PathBuf};

use crate::{
    LakeError, atomic,
    folder::Lake,
    history,
    published::{EVERY, TABLES},
    table,
};

const HEAD: &str = "-- The lake's tables as views; paths are relative to this file's folder.\n\
    -- A table's name gives the newest run's rows; `all_` before it, every run's, by `run`.\n";

/// Where the views lie.
pub(crate) fn path(root: &Path) -> PathBuf {
    root.join("views.sql")
}

/// Writes the views if they are not there as they should be.
pub(crate) fn write(lake: &Lake) -> Result<(), LakeError> {
    let views = text(lake)?;
    let path = path(lake.root());
    if atomic::read_if_there(&path)?.as_deref() == Some(views.as_bytes()) {
        return Ok(());
    }
    atomic::write(&lake.staging(), &path, views.as_bytes())
}

/// The views of the tables that the lake shows.
pub(crate) fn text(lake: &Lake) -> Result<String, LakeError> {
    let mut views = HEAD.to_owned();
    for name in history::TABLES {
        views.push_str(&format!(
            "create or replace view {name} as select * from \
             read_parquet('{TABLES}/{name}/*/{}', hive_partitioning = true, \
             hive_types = {{'run': BIGINT}}, union_by_name = true);\n",
            table::FILE
        ));
    }
    for newest in lake.newest_tables()? {
        let name = &newest.table;
        let Some(pipeline) = &newest.pipeline else {
            continue;
        };
        views.push_str(&format!(
            "create or replace view {name} as select * from \
             read_parquet('{TABLES}/{name}/pipeline={pipeline}/**/{}', hive_partitioning = true, \
             hive_types_autocast = false, union_by_name = true);\n",
            table::FILE
        ));
        if !lake.every_folder(name).is_dir() {
            continue;
        }
        views.push_str(&format!(
            "create or replace view all_{name} as select units.run, units.pipeline, units.stage, \
             made.fingerprint, made.* exclude (fingerprint) from \
             read_parquet('{EVERY}/{name}/**/{}', hive_partitioning = true, \
             hive_types_autocast = false, union_by_name = true) as made \
             join units on units.fingerprint = made.fingerprint and units.artifact = '{name}';\n",
            table::FILE
        ));
    }
    Ok(views)
}
