//! Files that appear whole or not at all.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{
        LazyLock,
        atomic::{AtomicU64, Ordering},
    },
    time::UNIX_EPOCH,
};

use crate::{LakeError, clock::now};

/// Tells apart the temporary files of one process.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Tells apart processes that have had the same number: the time at which this one first asked.
static STARTED: LazyLock<u128> = LazyLock::new(|| {
    let since = now().duration_since(UNIX_EPOCH);
    since.unwrap_or_default().as_nanos()
});

/// Writes `bytes` to `path` by way of a file in `staging`, synced before it is renamed.
pub(crate) fn write(staging: &Path, path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
    let beside = temporary_name(staging);
    let written = File::create_new(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(io_error("write", &beside))?;
    rename(&beside, path)
}

/// A name in `staging` that nobody else uses.
pub(crate) fn temporary_name(staging: &Path) -> PathBuf {
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    staging.join(format!("{}-{}-{number}.new", std::process::id(), *STARTED))
}

/// Moves a file to its final name, making the folders above it.
pub(crate) fn rename(from: &Path, to: &Path) -> Result<(), LakeError> {
    make_parent(to)?;
    fs::rename(from, to).map_err(io_error("write", to))
}

/// Makes the folder in which `path` lies.
pub(crate) fn make_parent(path: &Path) -> Result<(), LakeError> {
    match path.parent() {
        Some(parent) => fs::create_dir_all(parent).map_err(io_error("create", parent)),
        None => Ok(()),
    }
}

/// Reads a file that may not be there.
pub(crate) fn read_if_there(path: &Path) -> Result<Option<Vec<u8>>, LakeError> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(err) => Err(io_error("read", path)(err)),
    }
}

/// Returns a function that says what was tried, and where.
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
