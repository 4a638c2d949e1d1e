//! Files that appear whole or not at all.

use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::{
        LazyLock,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use crate::{
    LakeError,
    clock::{host, now},
};

/// Makes the names of one process's temporary files unique.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Distinguishes processes with the same number: the time at which this one first needed a name.
static STARTED: LazyLock<u128> = LazyLock::new(|| {
    let since = now().duration_since(UNIX_EPOCH);
    since.unwrap_or_default().as_nanos()
});

/// The machine, as processes are named after it.
static MACHINE: LazyLock<String> = LazyLock::new(|| {
    let named = host();
    let letters = named
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
    letters.take(HOST).collect()
});

/// Letters of a machine's name that are in the names of its processes.
const HOST: usize = 32;

/// Writes a file whole or not at all: beside it, synced, then renamed. A reader finds the old bytes
/// or the new ones, even after a crash of the program or the machine. Creates parent folders.
///
/// # Errors
///
/// Fails if the file cannot be written; the old file then remains.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
    make_parent(path)?;
    let folder = folder_of(path);
    write(folder, path, bytes)?;
    let synced = File::open(folder).and_then(|folder| folder.sync_all());
    synced.map_err(io_error("write", path))
}

/// Returns the folder of a file; the parent of a bare name is the empty path, which cannot be opened.
fn folder_of(path: &Path) -> &Path {
    let named = path.parent().filter(|folder| *folder != Path::new(""));
    named.unwrap_or(Path::new("."))
}

/// Writes `bytes` to `path` by way of a file in `staging`, synced before it is renamed.
pub(crate) fn write(staging: &Path, path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
    place(staging, path, |beside| {
        let written = File::create_new(beside).and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        });
        written.map_err(io_error("write", path))
    })
}

/// Renames to `path` the file that `make` creates under a temporary name in `staging`, which is
/// removed on failure.
pub(crate) fn place(
    staging: &Path,
    path: &Path,
    make: impl FnOnce(&Path) -> Result<(), LakeError>,
) -> Result<(), LakeError> {
    let beside = temporary_name(staging);
    let placed = make(&beside).and_then(|()| rename(&beside, path));
    if placed.is_err() {
        let _gone = fs::remove_file(&beside);
    }
    placed
}

/// A unique name of a file in `staging`.
pub(crate) fn temporary_name(staging: &Path) -> PathBuf {
    unique_name(staging, "new")
}

/// A name in `staging` that no attempt of any process on any machine has used.
pub(crate) fn unique_name(staging: &Path, ending: &str) -> PathBuf {
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    staging.join(format!("{}-{number}.{ending}", process_name()))
}

/// A name for this process that is never reused: its number, when it first needed a name, in
/// nanoseconds since 1970, and its machine, without `-` and `.`.
pub(crate) fn process_name() -> String {
    let own = || format!("{}-{}-{}", std::process::id(), *STARTED, *MACHINE);
    ::clock::process().unwrap_or_else(own)
}

/// The process in a name that begins with a process's.
pub(crate) fn process_of(name: &str) -> &str {
    let mut dashes = name.match_indices(['-', '.']);
    name.get(..dashes.nth(2).map_or(name.len(), |(at, _)| at))
        .unwrap_or(name)
}

/// When a process first needed a name, by its name.
pub(crate) fn started(process: &str) -> Option<SystemTime> {
    let nanoseconds = process.split('-').nth(1)?.parse().ok()?;
    Some(UNIX_EPOCH + Duration::from_nanos(nanoseconds))
}

/// Moves a file to its final name, creating parent folders. Across file systems, the file is first
/// copied beside the final name, under a name that no table's pattern matches.
pub(crate) fn rename(from: &Path, to: &Path) -> Result<(), LakeError> {
    make_parent(to)?;
    match fs::rename(from, to) {
        Err(err) if err.kind() == io::ErrorKind::CrossesDevices => {
            let beside = temporary_name(to.parent().unwrap_or(to));
            let copied = fs::copy(from, &beside)
                .and_then(|_| File::open(&beside)?.sync_all())
                .and_then(|()| fs::rename(&beside, to));
            if let Err(err) = copied {
                let _gone = fs::remove_file(&beside);
                return Err(io_error("write", to)(err));
            }
            fs::remove_file(from).map_err(io_error("remove", from))
        }
        // An empty folder makes room for the file.
        Err(err) if err.kind() == io::ErrorKind::IsADirectory => {
            let renamed = fs::remove_dir(to).and_then(|()| fs::rename(from, to));
            renamed.map_err(|_renaming| io_error("write", to)(err))
        }
        renamed => renamed.map_err(io_error("write", to)),
    }
}

/// Removes a file, if it exists, or an empty folder in its place.
pub(crate) fn remove_if_there(path: &Path) -> Result<(), LakeError> {
    let removed = match fs::remove_file(path) {
        Err(err) if err.kind() == io::ErrorKind::IsADirectory => fs::remove_dir(path),
        removed => removed,
    };
    unless_absent(path, removed)
}

/// Removes a folder with everything in it, if it exists.
pub(crate) fn remove_folder_if_there(path: &Path) -> Result<(), LakeError> {
    unless_absent(path, fs::remove_dir_all(path))
}

fn unless_absent(path: &Path, removed: io::Result<()>) -> Result<(), LakeError> {
    match removed {
        Err(err) if err.kind() != io::ErrorKind::NotFound => Err(io_error("remove", path)(err)),
        _ => Ok(()),
    }
}

/// Creates the parent folder of `path`.
pub(crate) fn make_parent(path: &Path) -> Result<(), LakeError> {
    match path.parent() {
        Some(parent) => fs::create_dir_all(parent).map_err(io_error("create", parent)),
        None => Ok(()),
    }
}

/// Opens a file to read it. A pipe, a folder or a link that leads nowhere in its place is no file: it is
/// not waited for, and what belongs there is written over it.
pub(crate) fn open(path: &Path) -> io::Result<File> {
    let is_file = match fs::metadata(path) {
        Ok(found) => found.is_file(),
        // A link that leads in a circle is there by itself.
        Err(err) if fs::symlink_metadata(path).is_err() => return Err(err),
        Err(_) => false,
    };
    if is_file {
        return File::open(path);
    }
    let what = "a folder, a pipe or a broken link is in the place of a file";
    Err(io::Error::new(io::ErrorKind::NotFound, what))
}

/// Whether something is in the place of a file that is none.
pub(crate) fn is_no_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok() && !path.is_file()
}

/// Reads a file, if it exists.
pub(crate) fn read_if_there(path: &Path) -> Result<Option<Vec<u8>>, LakeError> {
    let read = open(path).and_then(|mut file| {
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map(|_| bytes)
    });
    match read {
        Ok(bytes) => Ok(Some(bytes)),
        Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(err) => Err(io_error("read", path)(err)),
    }
}

/// Returns a function that adds the action and the path to an I/O error.
pub(crate) fn io_error(
    action: &'static str,
    path: &Path,
) -> impl FnOnce(io::Error) -> LakeError + use<> {
    let path = path.to_owned();
    move |source| LakeError::Io {
        action,
        path,
        source,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_file_replaces_the_old_one_and_leaves_nothing_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state/epoch.bin");
        for bytes in [&b"first"[..], b"a longer second", b""] {
            write_atomic(&path, bytes).unwrap();
            assert_eq!(fs::read(&path).unwrap(), bytes);
        }
        let beside = fs::read_dir(path.parent().unwrap()).unwrap();
        assert_eq!(beside.count(), 1);
    }

    #[test]
    fn the_folder_of_every_name_can_be_opened() {
        for (path, folder) in [("a.glb", "."), ("./a.glb", "."), ("/a", "/"), ("x/a", "x")] {
            assert_eq!(folder_of(Path::new(path)), Path::new(folder), "{path}");
        }
    }

    #[test]
    fn names_of_attempts_differ_and_tell_their_process() {
        let staging = Path::new("staging");
        let names = [(); 2].map(|()| unique_name(staging, "unit"));
        assert_ne!(names[0], names[1]);
        for name in names {
            let name = name.file_name().unwrap().to_str().unwrap();
            assert_eq!(process_of(name), process_name());
        }
        assert_eq!(process_of(&process_name()), process_name());
        let since = now().duration_since(started(&process_name()).unwrap());
        assert!(since.unwrap() < Duration::from_hours(1));
    }

    #[test]
    fn a_file_that_cannot_be_written_leaves_nothing_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a_folder");
        fs::create_dir(&path).unwrap();
        let inside = path.join("somebody's");
        fs::write(&inside, b"").unwrap();
        let failed = write_atomic(&path, b"bytes").unwrap_err();
        assert!(failed.to_string().contains("a_folder"), "{failed}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        // An empty folder makes room.
        fs::remove_file(&inside).unwrap();
        write_atomic(&path, b"bytes").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"bytes");
    }
}
