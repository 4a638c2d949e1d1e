//! The newest partitions as people see them: tables, files and views.

use std::{
    collections::BTreeSet,
    fs, io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Node, Record, RecordOutcome};

use crate::{
    LakeError,
    atomic::{self, io_error},
    folder::Lake,
    table,
};

/// Folder of the tables, below the lake.
pub(crate) const TABLES: &str = "tables";

/// Folder of everything that is no table, below the lake.
const FILES: &str = "files";

/// Shows exactly these partitions of a node: tables as Hive partitions, other files by name.
pub(crate) fn publish(
    lake: &Lake,
    pipeline: &str,
    node: &Node,
    made: &[(String, Record)],
) -> Result<(), LakeError> {
    let tables = lake
        .root()
        .join(TABLES)
        .join(node.output.artifact)
        .join(format!("pipeline={pipeline}"))
        .join(format!("stage={}", node.name.stage));
    let others = lake
        .root()
        .join(FILES)
        .join(pipeline)
        .join(&node.name.stage)
        .join(node.output.artifact);
    let mut in_tables = BTreeSet::new();
    let mut in_others = BTreeSet::new();
    for (partition, record) in made {
        let RecordOutcome::Made { files, .. } = &record.outcome else {
            continue;
        };
        for (name, file) in files {
            let path = if name == table::FILE {
                let folder = format!("{}={partition}", node.output.partition);
                let path = tables.join(folder).join(name);
                in_tables.insert(path.clone());
                path
            } else {
                let path = others.join(partition).join(name);
                in_others.insert(path.clone());
                path
            };
            show(lake, &lake.blobs().path(&file.digest), &path)?;
        }
    }
    remove_others(&tables, &in_tables)?;
    remove_others(&others, &in_others)?;
    if !in_tables.is_empty() {
        write_views(lake)?;
    }
    Ok(())
}

/// Makes `path` the same file as `blob`, or a copy where the file system has no hard links.
fn show(lake: &Lake, blob: &Path, path: &Path) -> Result<(), LakeError> {
    let same = fs::metadata(path).is_ok_and(|shown| {
        fs::metadata(blob).is_ok_and(|blob| (shown.dev(), shown.ino()) == (blob.dev(), blob.ino()))
    });
    if same {
        return Ok(());
    }
    let beside = atomic::temporary_name(&lake.staging());
    if fs::hard_link(blob, &beside).is_err() {
        fs::copy(blob, &beside).map_err(io_error("copy", blob))?;
    }
    atomic::rename(&beside, path)
}

/// Removes every file below `folder` that is not in `keep`, and folders left empty.
fn remove_others(folder: &Path, keep: &BTreeSet<PathBuf>) -> Result<(), LakeError> {
    let entries = match fs::read_dir(folder) {
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(io_error("read", folder))?,
    };
    for entry in entries {
        let path = entry.map_err(io_error("read", folder))?.path();
        if path.is_dir() {
            remove_others(&path, keep)?;
            // Fails, as it should, if something is left in it.
            let _kept = fs::remove_dir(&path);
        } else if !keep.contains(&path) {
            fs::remove_file(&path).map_err(io_error("remove", &path))?;
        }
    }
    Ok(())
}

/// Writes the tables as views for DuckDB: `duckdb -init data/lake/views.sql` from the same folder.
fn write_views(lake: &Lake) -> Result<(), LakeError> {
    let mut views =
        String::from("-- The lake's tables as views; paths are relative to this file's folder.\n");
    for table in lake.tables()? {
        let files = format!("'{TABLES}/{table}/**/*.parquet', hive_partitioning = true");
        views.push_str("create or replace view ");
        views.push_str(&table);
        views.push_str(" as select * from read_parquet(");
        views.push_str(&files);
        views.push_str(");\n");
    }
    let path = lake.root().join("views.sql");
    if atomic::read_if_there(&path)?.as_deref() == Some(views.as_bytes()) {
        return Ok(());
    }
    atomic::write(&lake.staging(), &path, views.as_bytes())
}
