//! The lake's tables as SQL views for DuckDB: `duckdb -init views.sql` from the lake's folder.

use std::collections::BTreeSet;

use dataflow::ArtifactName;

use crate::{
    LakeError, atomic,
    folder::{HISTORY, TABLES, VERSIONS, names_in},
    lake::Lake,
    table,
};

const HEAD: &str = "-- The lake's tables as views; paths are relative to this file's folder.\n\
    -- A table's name gives the newest run's rows; `all_` before it, every run's, by `run`.\n";

/// Writes the views if they are missing or outdated.
pub(crate) fn write(lake: &Lake) -> Result<(), LakeError> {
    let views = text(lake)?;
    let path = lake.folder.views();
    if atomic::read_if_there(&path)?.as_deref() == Some(views.as_bytes()) {
        return Ok(());
    }
    lake.folder.write(&path, views.as_bytes())
}

/// The views of the lake's published tables.
pub(crate) fn text(lake: &Lake) -> Result<String, LakeError> {
    let mut views = HEAD.to_owned();
    for name in HISTORY {
        views.push_str(&format!(
            "create or replace view {name} as select * from \
             read_parquet('{TABLES}/{name}/*/{}', hive_partitioning = true, \
             hive_types = {{'run': BIGINT}}, union_by_name = true);\n",
            table::FILE
        ));
    }
    for newest in newest_tables(lake)? {
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
        if !lake.folder.versions().join(name.as_str()).is_dir() {
            continue;
        }
        views.push_str(&format!(
            "create or replace view all_{name} as select units.run, units.pipeline, units.stage, \
             made.fingerprint, made.* exclude (fingerprint) from \
             read_parquet('{VERSIONS}/{name}/**/{}', hive_partitioning = true, \
             hive_types_autocast = false, union_by_name = true) as made \
             join units on units.fingerprint = made.fingerprint and units.artifact = '{name}';\n",
            table::FILE
        ));
    }
    Ok(views)
}

/// A published table, and the pipeline with the newest run among those that publish it; `None` if
/// no run has.
struct NewestTable {
    table: ArtifactName,
    pipeline: Option<String>,
}

/// Lists the tables with the pipeline of the newest run that publishes them.
fn newest_tables(lake: &Lake) -> Result<Vec<NewestTable>, LakeError> {
    let mut published: Vec<(ArtifactName, Vec<String>)> = Vec::new();
    for table in lake.tables()? {
        let folders = names_in(&lake.folder.tables().join(table.as_str()))?;
        let pipelines = folders
            .iter()
            .filter_map(|name| name.strip_prefix("pipeline=").map(str::to_owned));
        published.push((table, pipelines.collect()));
    }
    let newest = newest_first(lake, published.iter().flat_map(|(_, pipelines)| pipelines))?;
    let tables = published.into_iter().map(|(table, pipelines)| NewestTable {
        table,
        pipeline: newest
            .iter()
            .find(|pipeline| pipelines.contains(pipeline))
            .cloned(),
    });
    Ok(tables.collect())
}

/// Orders pipelines by their newest runs, the newest first; those without a run are left out. Reads
/// no more records than needed.
fn newest_first<'p>(
    lake: &Lake,
    pipelines: impl Iterator<Item = &'p String>,
) -> Result<Vec<String>, LakeError> {
    let mut left: BTreeSet<&String> = pipelines.collect();
    let mut ordered = Vec::new();
    for number in lake.register.ordered()?.into_iter().rev() {
        if left.is_empty() {
            break;
        }
        // A damaged record of one run does not hide the tables of others.
        if let Ok(run) = lake.register.read(number)
            && left.remove(&run.record.pipeline)
        {
            ordered.push(run.record.pipeline);
        }
    }
    Ok(ordered)
}
