//! Checks a dataset's files without opening them.
//!
//! Every input file of a recording is checked here first: a pipe that would block, a file that is far
//! too large or an unreadable one is reported at once, before it is digested.

use std::{
    fs::{self, File, FileType},
    io::ErrorKind,
    os::unix::fs::{FileTypeExt as _, PermissionsExt as _},
};

use dataflow::SourceFile;

use crate::error::RecordingError;

/// The right to read of owner, group and others.
const READABLE: u32 = 0o444;

/// Says whether a readable file exists at a path; `false` if the path does not exist.
///
/// # Errors
///
/// Fails if it is not a regular file, has more than `limit` bytes or is not readable.
pub(crate) fn is_there(file: &SourceFile, limit: u64) -> Result<bool, RecordingError> {
    let unreadable = |source| RecordingError::Unreadable {
        file: file.name.clone(),
        source,
    };
    let other = |found| RecordingError::NotAFile {
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
        return Err(RecordingError::TooLarge {
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

/// Names the type of a path that is not a regular file.
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
