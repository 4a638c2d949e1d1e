//! Publication of the newest partitions: tables, files, and every table ever made.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use dataflow::{Digest, FileRef, Node, NodeName, PartitionKey, PublishedUnit, Stamp};

use crate::{
    LakeError,
    atomic::{self, io_error},
    folder::{FILES, PublishedFolders, REPORTS, files_below, names_in},
    lake::Lake,
    newest::{PublishedFile, PublishedFiles},
    table,
};

/// Tries to link a blob while another process replaces it with the same bytes: the opened file then
/// has no name any more, and the system refuses to link it.
const LINK_TRIES: u32 = 100;

/// A file to publish.
struct FileToPublish<'a> {
    file: &'a FileRef,
    fingerprint: &'a Digest,
    partition: &'a PartitionKey,
    is_table: bool,
}

/// Publishes exactly these partitions of a node: tables as Hive partitions, charts and other files
/// by name. Returns the published files, or `None` if they equal `before` and the file system
/// confirms it.
pub(crate) fn publish(
    lake: &Lake,
    pipeline: &str,
    node: &Node,
    made: &[PublishedUnit],
    before: Option<&PublishedFiles>,
) -> Result<Option<PublishedFiles>, LakeError> {
    let wanted = files_to_publish(lake, pipeline, node, made);
    let folders = PublishedFolders::of(pipeline, &node.name).all();
    if let Some(before) = before
        && is_published(lake, before, &wanted)
        && is_all(lake, &folders, before)?
        && wanted
            .values()
            .all(|file| version_table(lake, node, file).is_none_or(|version| version.exists()))
    {
        return Ok(None);
    }
    lake.prepare()?;
    lake.changing.mark(pipeline)?;
    let _turn = lake.locks.lock_publication(pipeline)?;
    let mut published = PublishedFiles::new();
    for (path, file) in &wanted {
        let target = lake.folder.join(path);
        link_file(lake, &file.file.digest, &target)?;
        if let Some(version) = version_table(lake, node, file) {
            link_file(lake, &file.file.digest, &version)?;
        }
        let stamp = Stamp::read(&target).map_err(io_error("read", &target))?;
        let file = PublishedFile {
            digest: file.file.digest,
            fingerprint: *file.fingerprint,
            stamp,
        };
        published.insert(path.clone(), file);
    }
    for folder in folders {
        remove_unpublished(lake, &lake.folder.join(folder), before, &published)?;
    }
    Ok(Some(published))
}

/// The path of a table among the versions of its partition.
fn version_table(lake: &Lake, node: &Node, file: &FileToPublish) -> Option<PathBuf> {
    let version = || {
        lake.folder.version_table(
            &node.name.artifact,
            node.output.partition,
            file.partition,
            file.fingerprint,
        )
    };
    file.is_table.then(version)
}

/// Lists the files to publish. Those that were left in the depot are published once something has
/// asked for them.
fn files_to_publish<'a>(
    lake: &Lake,
    pipeline: &str,
    node: &Node,
    made: &[PublishedUnit<'a>],
) -> BTreeMap<String, FileToPublish<'a>> {
    let folders = PublishedFolders::of(pipeline, &node.name);
    let mut wanted = BTreeMap::new();
    for unit in made {
        for (name, file) in unit.outcome.files().into_iter().flatten() {
            let path = folders.path(node.output.partition, unit.partition, name.as_str());
            if lake.is_only_in_depot(&file.digest) {
                continue;
            }
            let file = FileToPublish {
                file,
                fingerprint: unit.fingerprint,
                partition: unit.partition,
                is_table: *name == *table::FILE,
            };
            wanted.insert(path, file);
        }
    }
    wanted
}

/// Whether exactly the wanted files are published and unmodified.
fn is_published(
    lake: &Lake,
    before: &PublishedFiles,
    wanted: &BTreeMap<String, FileToPublish>,
) -> bool {
    before.len() == wanted.len()
        && before
            .iter()
            .zip(wanted)
            .all(|((path, published), (name, file))| {
                path == name
                    && published.digest == file.file.digest
                    && published.fingerprint == *file.fingerprint
                    && Stamp::read(&lake.folder.join(path)).is_ok_and(|stamp| {
                        // Another unit with the same bytes has taken their blob into use.
                        stamp == published.stamp
                            || lake.blobs.stamps.get(&published.digest) == Some(stamp)
                    })
            })
}

/// Whether the folders hold only these files.
fn is_all(lake: &Lake, folders: &[PathBuf], published: &PublishedFiles) -> Result<bool, LakeError> {
    for folder in folders {
        for path in files_below(&lake.folder.join(folder))? {
            if !published.contains_key(&*lake.folder.name_of(&path)) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// Unpublishes stages that are no longer in the pipeline: the files in `before`, as far as known.
pub(crate) fn retire(
    lake: &Lake,
    pipeline: &str,
    is_kept: &dyn Fn(&NodeName) -> bool,
    before: &PublishedFiles,
) -> Result<(), LakeError> {
    let is_name_kept = |stage: &str, artifact: &str| {
        NodeName::parse(&format!("{stage}.{artifact}")).is_some_and(|node| is_kept(&node))
    };
    let mut old = Vec::new();
    for table in lake.tables()? {
        let folder = lake.folder.table_of(&table, pipeline);
        for name in names_in(&folder)? {
            let stage = name.strip_prefix("stage=").unwrap_or(&name);
            if !is_name_kept(stage, table.as_str()) {
                old.push(folder.join(name));
            }
        }
    }
    for folder in [FILES, REPORTS] {
        let folder = lake.folder.join(folder).join(pipeline);
        for stage in names_in(&folder)? {
            for artifact in names_in(&folder.join(&stage))? {
                if !is_name_kept(&stage, &artifact) {
                    old.push(folder.join(&stage).join(artifact));
                }
            }
        }
    }
    if old.is_empty() {
        return Ok(());
    }
    lake.prepare()?;
    lake.changing.mark(pipeline)?;
    let _turn = lake.locks.lock_publication(pipeline)?;
    for folder in old {
        remove_unpublished(lake, &folder, Some(before), &PublishedFiles::new())?;
        let _kept = fs::remove_dir(&folder);
        let _kept = folder.parent().map(fs::remove_dir);
    }
    Ok(())
}

/// Hard-links the blob at `path`, or copies it if the file system has no hard links.
pub(crate) fn link_file(lake: &Lake, digest: &Digest, path: &Path) -> Result<(), LakeError> {
    let blob = lake.blobs.path(digest);
    let same = fs::metadata(path).is_ok_and(|published| {
        fs::metadata(&blob)
            .is_ok_and(|blob| (published.dev(), published.ino()) == (blob.dev(), blob.ino()))
    });
    if same {
        return Ok(());
    }
    lake.blobs.touch(digest);
    let mut tries = LINK_TRIES;
    atomic::place(&lake.folder.staging(), path, |beside| {
        loop {
            tries -= 1;
            match fs::hard_link(&blob, beside) {
                Ok(()) => return Ok(()),
                Err(err) if has_no_links(&err) => return copy(&blob, beside),
                // Another process has just replaced the blob with the same bytes.
                Err(err) if err.kind() == io::ErrorKind::NotFound && tries > 0 && blob.exists() => {
                }
                Err(err) => return Err(io_error("link", &blob)(err)),
            }
        }
    })
}

/// Copies a file to `path`, so that damage to one does not affect the other.
pub(crate) fn copy_file(lake: &Lake, from: &Path, path: &Path) -> Result<(), LakeError> {
    atomic::place(&lake.folder.staging(), path, |beside| copy(from, beside))
}

/// Copies a file, synced, under a temporary name.
fn copy(from: &Path, to: &Path) -> Result<(), LakeError> {
    fs::copy(from, to)
        .and_then(|_| File::open(to)?.sync_all())
        .map_err(io_error("copy", from))
}

/// Whether the file system does not support hard links.
fn has_no_links(err: &io::Error) -> bool {
    use io::ErrorKind::{CrossesDevices, PermissionDenied, TooManyLinks, Unsupported};
    matches!(
        err.kind(),
        CrossesDevices | PermissionDenied | TooManyLinks | Unsupported
    )
}

/// Removes every unpublished file below `folder`, and empty folders.
fn remove_unpublished(
    lake: &Lake,
    folder: &Path,
    before: Option<&PublishedFiles>,
    published: &PublishedFiles,
) -> Result<(), LakeError> {
    let entries = match fs::read_dir(folder) {
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(io_error("read", folder))?,
    };
    for entry in entries {
        let entry = entry.map_err(io_error("read", folder))?;
        let path = entry.path();
        // A link to a folder is not gone into.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_unpublished(lake, &path, before, published)?;
            // Fails, as it should, if something is left in it.
            let _kept = fs::remove_dir(&path);
            continue;
        }
        let name = lake.folder.name_of(&path);
        if !published.contains_key(&*name) {
            if let Some(file) = before.and_then(|before| before.get(&*name)) {
                lake.blobs.touch(&file.digest);
            }
            atomic::remove_if_there(&path)?;
        }
    }
    Ok(())
}
