//! Locks between processes that use one lake.

use std::fs::File;

use crate::{
    LakeError,
    atomic::{self, io_error},
    folder::Lake,
};

/// Waits until no other holder has the lock of this name. It is let go when the file is closed, and
/// so by the system when its process dies.
pub(crate) fn wait_for(lake: &Lake, name: &str) -> Result<File, LakeError> {
    let path = lake.root().join("locks").join(name);
    atomic::make_parent(&path)?;
    let lock = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .map_err(io_error("write", &path))?;
    lock.lock().map_err(io_error("lock", &path))?;
    Ok(lock)
}
