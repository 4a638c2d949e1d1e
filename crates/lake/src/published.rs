//! The newest partitions as people see them: tables, files, and every table ever made.

use std::{
    collections::BTreeMap,
    fs, io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Digest, Node, NodeName, RecordOutcome, Showing};

use crate::{
    LakeError,
    atomic::{self, io_error},
    folder::{Lake, names_in},
    lock::{self, Lock},
    newest::{Shown, ShownFile},
    stamp::Stamp,
    table,
};

/// Folder of the tables, below the lake.
pub(crate) const TABLES: &str = "tables";

/// Folder of everything that is neither table nor chart, below the lake.
pub(crate) const FILES: &str = "files";

/// Folder of charts, below the lake.
pub(crate) const REPORTS: &str = "reports";

/// How often a blob is linked that another process replaces with the same bytes at that moment: what
/// was found by its name has no name any more, and the system refuses to link it.
const LINK_TRIES: u32 = 100;

/// Ending of a chart's name.
const CHART: &str = ".svg";

/// Folder of every table ever made, by the unit that made it, below the lake.
pub(crate) const EVERY: &str = "every";

/// The folder of a node's tables, below the lake.
fn tables_of(pipeline: &str, node: &NodeName) -> PathBuf {
    Path::new(TABLES)
        .join(&node.artifact)
        .join(format!("pipeline={pipeline}"))
        .join(format!("stage={}", node.stage))
}

/// The folder of a node's charts, or of its other files, below the lake.
fn files_of(folder: &str, pipeline: &str, node: &NodeName) -> PathBuf {
    Path::new(folder)
        .join(pipeline)
        .join(&node.stage)
        .join(&node.artifact)
}

/// A file to be shown.
struct Wanted<'a> {
    digest: Digest,
    fingerprint: &'a Digest,
    partition: &'a str,
    is_table: bool,
}

/// Shows exactly these partitions of a node: tables as Hive partitions, charts and other files by name.
/// Returns what is shown now, or `None` if that is what `before` says and the file system confirms.
pub(crate) fn publish(
    lake: &Lake,
    pipeline: &str,
    node: &Node,
    made: &[Showing],
    before: Option<&Shown>,
) -> Result<Option<Shown>, LakeError> {
    let wanted = wanted(pipeline, node, made);
    if before.is_some_and(|before| is_shown(lake, before, &wanted)) {
        return Ok(None);
    }
    let _turn = wait_for_turn(lake, pipeline)?;
    let mut shown = Shown::new();
    for (path, file) in &wanted {
        let target = lake.root().join(path);
        show(lake, &file.digest, &target)?;
        if file.is_table {
            let column = format!("{}={}", node.output.partition, file.partition);
            let unit = format!("fingerprint={}", file.fingerprint);
            let every = lake.root().join(EVERY).join(&node.name.artifact);
            show(
                lake,
                &file.digest,
                &every.join(column).join(unit).join(table::FILE),
            )?;
        }
        let stamp = Stamp::read(&target).map_err(io_error("read", &target))?;
        let file = ShownFile {
            digest: file.digest,
            fingerprint: *file.fingerprint,
            stamp,
        };
        shown.insert(path.clone(), file);
    }
    for folder in [
        tables_of(pipeline, &node.name),
        files_of(FILES, pipeline, &node.name),
        files_of(REPORTS, pipeline, &node.name),
    ] {
        hide_others(lake, &lake.root().join(folder), before, &shown)?;
    }
    Ok(Some(shown))
}

fn wanted<'a>(pipeline: &str, node: &Node, made: &[Showing<'a>]) -> BTreeMap<String, Wanted<'a>> {
    let tables = tables_of(pipeline, &node.name);
    let others = files_of(FILES, pipeline, &node.name);
    let charts = files_of(REPORTS, pipeline, &node.name);
    let mut wanted = BTreeMap::new();
    for unit in made {
        let RecordOutcome::Made { files, .. } = unit.outcome else {
            continue;
        };
        for (name, file) in files {
            let is_table = name == table::FILE;
            let folder = if is_table {
                tables.join(format!("{}={}", node.output.partition, unit.partition))
            } else if name.ends_with(CHART) {
                charts.join(unit.partition)
            } else {
                others.join(unit.partition)
            };
            let file = Wanted {
                digest: file.digest,
                fingerprint: unit.fingerprint,
                partition: unit.partition,
                is_table,
            };
            wanted.insert(folder.join(name).to_string_lossy().into_owned(), file);
        }
    }
    wanted
}

/// Whether exactly the wanted files are shown, each untouched since.
fn is_shown(lake: &Lake, before: &Shown, wanted: &BTreeMap<String, Wanted>) -> bool {
    before.len() == wanted.len()
        && before
            .iter()
            .zip(wanted)
            .all(|((path, shown), (name, file))| {
                path == name
                    && shown.digest == file.digest
                    && shown.fingerprint == *file.fingerprint
                    && Stamp::read(&lake.root().join(path)).is_ok_and(|stamp| stamp == shown.stamp)
            })
}

/// Removes what stages that are no longer in the pipeline have shown: `before`, as far as is known.
pub(crate) fn retire(
    lake: &Lake,
    pipeline: &str,
    is_kept: &dyn Fn(&NodeName) -> bool,
    before: &Shown,
) -> Result<(), LakeError> {
    let mut old = Vec::new();
    for table in lake.tables()? {
        let folder = lake.table_folder(&table, pipeline);
        for name in names_in(&folder)? {
            let stage = name.strip_prefix("stage=").unwrap_or(&name);
            if !is_kept(&NodeName::new(stage, &table)) {
                old.push(folder.join(name));
            }
        }
    }
    for folder in [FILES, REPORTS] {
        let folder = lake.root().join(folder).join(pipeline);
        for stage in names_in(&folder)? {
            for artifact in names_in(&folder.join(&stage))? {
                if !is_kept(&NodeName::new(&stage, &artifact)) {
                    old.push(folder.join(&stage).join(artifact));
                }
            }
        }
    }
    if old.is_empty() {
        return Ok(());
    }
    let _turn = wait_for_turn(lake, pipeline)?;
    for folder in old {
        hide_others(lake, &folder, Some(before), &Shown::new())?;
        let _kept = fs::remove_dir(&folder);
        let _kept = folder.parent().map(fs::remove_dir);
    }
    Ok(())
}

/// Lets one process at a time change what a pipeline shows.
pub(crate) fn wait_for_turn(lake: &Lake, pipeline: &str) -> Result<Lock, LakeError> {
    let name = format!("published-{pipeline}");
    lock::wait_for(&lake.locks(), &name, "what the pipeline shows", &|_| {})
}

/// Makes `path` the same file as the blob, or a copy where the file system has no hard links.
pub(crate) fn show(lake: &Lake, digest: &Digest, path: &Path) -> Result<(), LakeError> {
    let blob = lake.blobs().path(digest);
    let same = fs::metadata(path).is_ok_and(|shown| {
        fs::metadata(&blob).is_ok_and(|blob| (shown.dev(), shown.ino()) == (blob.dev(), blob.ino()))
    });
    if same {
        return Ok(());
    }
    let beside = atomic::temporary_name(&lake.staging());
    lake.blobs().touch(digest);
    let mut tries = LINK_TRIES;
    loop {
        tries -= 1;
        match fs::hard_link(&blob, &beside) {
            Ok(()) => break,
            Err(err) if has_no_links(&err) => {
                fs::copy(&blob, &beside).map_err(io_error("copy", &blob))?;
                break;
            }
            // Another process has just put the same bytes in place of those that were found.
            Err(err) if err.kind() == io::ErrorKind::NotFound && tries > 0 && blob.exists() => {}
            Err(err) => return Err(io_error("link", &blob)(err)),
        }
    }
    let renamed = atomic::rename(&beside, path);
    if renamed.is_err() {
        let _gone = fs::remove_file(&beside);
    }
    renamed
}

/// Whether the file system refuses hard links as such.
fn has_no_links(err: &io::Error) -> bool {
    use io::ErrorKind::{CrossesDevices, PermissionDenied, TooManyLinks, Unsupported};
    matches!(
        err.kind(),
        CrossesDevices | PermissionDenied | TooManyLinks | Unsupported
    )
}

/// Removes every file below `folder` that is not shown, and folders left empty.
fn hide_others(
    lake: &Lake,
    folder: &Path,
    before: Option<&Shown>,
    shown: &Shown,
) -> Result<(), LakeError> {
    let entries = match fs::read_dir(folder) {
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(io_error("read", folder))?,
    };
    for entry in entries {
        let path = entry.map_err(io_error("read", folder))?.path();
        if path.is_dir() {
            hide_others(lake, &path, before, shown)?;
            // Fails, as it should, if something is left in it.
            let _kept = fs::remove_dir(&path);
            continue;
        }
        let name = path.strip_prefix(lake.root()).unwrap_or(&path);
        let name = name.to_string_lossy();
        if !shown.contains_key(&*name) {
            if let Some(file) = before.and_then(|before| before.get(&*name)) {
                lake.blobs().touch(&file.digest);
            }
            atomic::remove_if_there(&path)?;
        }
    }
    Ok(())
}
