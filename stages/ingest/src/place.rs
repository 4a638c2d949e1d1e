//! What lies where a dataset's file belongs, found out without opening it.
//!
//! Whatever a recording reads is looked at here first: a pipe that would be waited for, a file that is far
//! too large or that may not be read is told at once, and never gets as far as being digested.

use std::{
    fs::{self, File, FileType},
    io::ErrorKind,
    os::unix::fs::{FileTypeExt as _, PermissionsExt as _},
};

use dataflow::SourceFile;

use crate::error::Unusable;

/// The right to read of owner, group and others.
const READABLE: u32 = 0o444;

/// Says whether a file that can be read lies in its place; `false` if nothing lies there.
///
/// # Errors
///
/// Fails if something else lies there, if it has more than `limit` bytes or if it may not be read.
pub(crate) fn is_there(file: &SourceFile, limit: u64) -> Result<bool, Unusable> {
    let unreadable = |source| Unusable::Unreadable {
        file: file.name.clone(),
        source,
    };
    let other = |found| Unusable::NotAFile {
        file: file.name.clone(),
        found,
    };
    let metadata = match fs::metadata(&file.path) {
        Ok(metadata) => metadata,
        Err(err) if err.kind() == ErrorKind::NotFound => {
            return match fs::symlink_metadata(&file.path) {
                Ok(_) => Err(other("a link to nothing")),
                Err(_) => Ok(false),
            };
        }
        Err(source) => return Err(unreadable(source)),
    };
    if !metadata.is_file() {
        return Err(other(kind(metadata.file_type())));
    }
    if metadata.len() > limit {
        return Err(Unusable::TooLarge {
            file: file.name.clone(),
            found: metadata.len(),
            limit,
        });
    }
    // Opening costs as much as all of the above; of a file that everybody may read it tells nothing.
    if metadata.permissions().mode() & READABLE != READABLE {
        File::open(&file.path).map_err(unreadable)?;
    }
    Ok(true)
}

/// Names what is no file.
fn kind(found: FileType) -> &'static str {
    if found.is_dir() {
        "a folder"
    } else if found.is_fifo() {
        "a named pipe"
    } else if found.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}
