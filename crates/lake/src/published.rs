//! The newest partitions as people see them: tables, files, and every table ever made.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Digest, Node, NodeName, Showing};

use crate::{
    LakeError,
    atomic::{self, io_error},
    changing,
    folder::{Lake, names_in},
    lock::{self, Lock},
    newest::{Shown, ShownFile},
    recorded::files_of,
    stamp::Stamp,
    table,
    verify::files_below,
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

/// What stands before the digits of a unit in the name of the folder of its table among all.
pub(crate) const FINGERPRINT: &str = "fingerprint=";

/// The folders, below the lake, in which what a node made is shown.
pub(crate) struct Folders {
    tables: PathBuf,
    files: PathBuf,
    charts: PathBuf,
}

impl Folders {
    pub(crate) fn of(pipeline: &str, node: &NodeName) -> Self {
        let of = |folder| {
            Path::new(folder)
                .join(pipeline)
                .join(&node.stage)
                .join(&node.artifact)
        };
        Self {
            tables: Path::new(TABLES)
                .join(&node.artifact)
                .join(format!("pipeline={pipeline}"))
                .join(format!("stage={}", node.stage)),
            files: of(FILES),
            charts: of(REPORTS),
        }
    }

    /// Where a file of a partition is shown.
    pub(crate) fn path(&self, column: &str, partition: &str, name: &str) -> String {
        let folder = if name == table::FILE {
            self.tables.join(format!("{column}={partition}"))
        } else if name.ends_with(CHART) {
            self.charts.join(partition)
        } else {
            self.files.join(partition)
        };
        folder.join(name).to_string_lossy().into_owned()
    }

    fn all(self) -> [PathBuf; 3] {
        [self.tables, self.files, self.charts]
    }
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
    let folders = Folders::of(pipeline, &node.name).all();
    if let Some(before) = before
        && is_shown(lake, before, &wanted)
        && is_all(lake, &folders, before)?
    {
        return Ok(None);
    }
    changing::mark(lake, pipeline)?;
    let _turn = wait_for_turn(lake, pipeline)?;
    let mut shown = Shown::new();
    for (path, file) in &wanted {
        let target = lake.root().join(path);
        show(lake, &file.digest, &target)?;
        if file.is_table {
            let every = every_path(
                lake.root(),
                &node.name.artifact,
                node.output.partition,
                file.partition,
                file.fingerprint,
            );
            show(lake, &file.digest, &every)?;
        }
        let stamp = Stamp::read(&target).map_err(io_error("read", &target))?;
        let file = ShownFile {
            digest: file.digest,
            fingerprint: *file.fingerprint,
            stamp,
        };
        shown.insert(path.clone(), file);
    }
    for folder in folders {
        hide_others(lake, &lake.root().join(folder), before, &shown)?;
    }
    Ok(Some(shown))
}

/// Where the table of a unit lies, whatever is newest.
pub(crate) fn every_path(
    root: &Path,
    artifact: &str,
    column: &str,
    partition: &str,
    fingerprint: &Digest,
) -> PathBuf {
    root.join(EVERY)
        .join(artifact)
        .join(format!("{column}={partition}"))
        .join(format!("{FINGERPRINT}{fingerprint}"))
        .join(table::FILE)
}

fn wanted<'a>(pipeline: &str, node: &Node, made: &[Showing<'a>]) -> BTreeMap<String, Wanted<'a>> {
    let folders = Folders::of(pipeline, &node.name);
    let mut wanted = BTreeMap::new();
    for unit in made {
        for (name, file) in files_of(unit.outcome).into_iter().flatten() {
            let path = folders.path(node.output.partition, unit.partition, name);
            let file = Wanted {
                digest: file.digest,
                fingerprint: unit.fingerprint,
                partition: unit.partition,
                is_table: name == table::FILE,
            };
            wanted.insert(path, file);
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
                    && Stamp::read(&lake.root().join(path)).is_ok_and(|stamp| {
                        // Another unit that made the same bytes has taken their blob into use.
                        stamp == shown.stamp || lake.blobs().stamp(&shown.digest) == Some(stamp)
                    })
            })
}

/// Whether nothing but these files lies in the folders.
fn is_all(lake: &Lake, folders: &[PathBuf], shown: &Shown) -> Result<bool, LakeError> {
    for folder in folders {
        for path in files_below(&lake.root().join(folder))? {
            let name = path.strip_prefix(lake.root()).unwrap_or(&path);
            if !shown.contains_key(&*name.to_string_lossy()) {
                return Ok(false);
            }
        }
    }
    Ok(true)
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
    changing::mark(lake, pipeline)?;
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
    lake.blobs().touch(digest);
    let mut tries = LINK_TRIES;
    by_way_of(lake, path, |beside| {
        loop {
            tries -= 1;
            match fs::hard_link(&blob, beside) {
                Ok(()) => return Ok(()),
                Err(err) if has_no_links(&err) => return copy(&blob, beside),
                // Another process has just put the same bytes in place of those that were found.
                Err(err) if err.kind() == io::ErrorKind::NotFound && tries > 0 && blob.exists() => {
                }
                Err(err) => return Err(io_error("link", &blob)(err)),
            }
        }
    })
}

/// Puts a copy of a file at `path`: what happens to one does not happen to the other.
pub(crate) fn show_copy(lake: &Lake, from: &Path, path: &Path) -> Result<(), LakeError> {
    by_way_of(lake, path, |beside| copy(from, beside))
}

/// Copies a file, synced, under a name that nobody looks at.
fn copy(from: &Path, to: &Path) -> Result<(), LakeError> {
    fs::copy(from, to)
        .and_then(|_| File::open(to)?.sync_all())
        .map_err(io_error("copy", from))
}

/// Puts at `path` what `make` puts elsewhere first. Nothing is left of what cannot be put there.
fn by_way_of(
    lake: &Lake,
    path: &Path,
    make: impl FnOnce(&Path) -> Result<(), LakeError>,
) -> Result<(), LakeError> {
    let beside = atomic::temporary_name(&lake.staging());
    let put = make(&beside).and_then(|()| atomic::rename(&beside, path));
    if put.is_err() {
        let _gone = fs::remove_file(&beside);
    }
    put
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
