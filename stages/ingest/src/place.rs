//! Checks a dataset's files without opening them.
//!
//! Every input file of a recording is checked here first: a pipe that would block, a file that is far
//! too large or an unreadable one is reported at once, before it is digested.

use std::{
    fs::{self, File, FileType, Metadata},
    io::{self, ErrorKind},
    os::unix::fs::{FileTypeExt as _, PermissionsExt as _},
};

use dataflow::{SourceFile, Stamp};

use crate::error::RecordingError;

/// The right to read of owner, group and others.
const READABLE: u32 = 0o444;

/// Looks for a readable file and returns it with its stamp; `None` if nothing is at its path.
///
/// # Errors
///
/// Fails if it is not a regular file, has more than `limit` bytes or is not readable.
pub(crate) fn find(file: SourceFile, limit: u64) -> Result<Option<SourceFile>, RecordingError> {
    match fs::metadata(&file.path) {
        Ok(metadata) => accept(file, &metadata, limit).map(Some),
        Err(err) if err.kind() == ErrorKind::NotFound => match fs::symlink_metadata(&file.path) {
            Ok(_) => Err(RecordingError::NotAFile {
                file: file.name,
                found: "a link to nothing",
            }),
            Err(_) => Ok(None),
        },
        Err(source) => Err(unreadable(file, source)),
    }
}

/// Returns a readable file that has this metadata with its stamp.
///
/// # Errors
///
/// As [`find`].
pub(crate) fn accept(
    file: SourceFile,
    metadata: &Metadata,
    limit: u64,
) -> Result<SourceFile, RecordingError> {
    if !metadata.is_file() {
        return Err(RecordingError::NotAFile {
            file: file.name,
            found: kind(metadata.file_type()),
        });
    }
    if metadata.len() > limit {
        return Err(RecordingError::TooLarge {
            file: file.name,
            found: metadata.len(),
            limit,
        });
    }
    // Opening costs as much as all of the above; of a file that everybody may read it tells nothing.
    if metadata.permissions().mode() & READABLE != READABLE
        && let Err(source) = File::open(&file.path)
    {
        return Err(unreadable(file, source));
    }
    Ok(SourceFile {
        stamp: Some(Stamp::of(metadata)),
        ..file
    })
}

fn unreadable(file: SourceFile, source: io::Error) -> RecordingError {
    RecordingError::Unreadable {
        file: file.name,
        source,
    }
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
