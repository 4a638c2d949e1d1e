//! The newest partitions as people see them: tables, files and views.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Node, RecordOutcome};

use crate::{
    LakeError,
    atomic::{self, io_error},
    folder::{Lake, names_in},
    lock, table,
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
    made: &[(String, RecordOutcome)],
) -> Result<(), LakeError> {
    let _turn = wait_for_turn(lake, pipeline)?;
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
    for (partition, outcome) in made {
        let RecordOutcome::Made { files, .. } = outcome else {
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

/// Removes what stages that are no longer in the pipeline have shown.
pub(crate) fn retire(lake: &Lake, pipeline: &str, kept: &[Node]) -> Result<(), LakeError> {
    let _turn = wait_for_turn(lake, pipeline)?;
    for table in lake.tables()? {
        let folder = lake.table_folder(&table, pipeline);
        for name in names_in(&folder)? {
            let is_kept = kept.iter().any(|node| {
                node.output.artifact == table && name == format!("stage={}", node.name.stage)
            });
            if !is_kept {
                remove_others(&folder.join(&name), &BTreeSet::new())?;
                let _kept = fs::remove_dir(folder.join(&name));
            }
        }
    }
    let folder = lake.root().join(FILES).join(pipeline);
    for name in names_in(&folder)? {
        if !kept.iter().any(|node| node.name.stage == name) {
            remove_others(&folder.join(&name), &BTreeSet::new())?;
            let _kept = fs::remove_dir(folder.join(&name));
        }
    }
    Ok(())
}

/// Lets one process at a time change what a pipeline shows; the turn ends when the file is closed.
fn wait_for_turn(lake: &Lake, pipeline: &str) -> Result<File, LakeError> {
    lock::wait_for(lake, &format!("published-{pipeline}"))
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
    match fs::hard_link(blob, &beside) {
        Ok(()) => {}
        Err(err) if has_no_links(&err) => {
            fs::copy(blob, &beside).map_err(io_error("copy", blob))?;
        }
        Err(err) => return Err(io_error("link", blob)(err)),
    }
    atomic::rename(&beside, path)
}

/// Whether the file system refuses hard links as such.
fn has_no_links(err: &io::Error) -> bool {
    use io::ErrorKind::{CrossesDevices, PermissionDenied, TooManyLinks, Unsupported};
    matches!(
        err.kind(),
        CrossesDevices | PermissionDenied | TooManyLinks | Unsupported
    )
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
            match fs::remove_file(&path) {
                Err(err) if err.kind() != io::ErrorKind::NotFound => {
                    return Err(io_error("remove", &path)(err));
                }
                _ => {}
            }
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
