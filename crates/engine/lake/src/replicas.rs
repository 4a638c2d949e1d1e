//! Small irreplaceable files are stored twice: in place, and below `copies/`.
//!
//! The file itself has precedence; its copy is read if it is lost or damaged, until the next run
//! restores it.

use std::path::Path;

use crate::{
    LakeError, atomic,
    folder::{Folder, names_in},
};

/// Writes a file and its copy.
pub(crate) fn write(folder: &Folder, path: &Path, bytes: &[u8]) -> Result<(), LakeError> {
    folder.write(path, bytes)?;
    folder.write(&folder.copy_of(path), bytes)
}

/// Reads a file, or its copy if it is lost or `parse` refuses it. Returns `None` if neither exists.
///
/// # Errors
///
/// Fails with the error of `parse` for the file, or for the copy if only that exists.
pub(crate) fn read<T>(
    folder: &Folder,
    path: &Path,
    parse: impl Fn(&Path, &[u8]) -> Result<T, LakeError>,
) -> Result<Option<T>, LakeError> {
    let read = |path: &Path| match atomic::read_if_there(path)? {
        Some(bytes) => parse(path, &bytes).map(Some),
        None => Ok(None),
    };
    let first = read(path);
    if let Ok(Some(_)) = first {
        return first;
    }
    match (read(&folder.copy_of(path)), first) {
        (Ok(Some(value)), _) => Ok(Some(value)),
        (_, Err(err)) | (Err(err), _) => Err(err),
        (Ok(None), first) => first,
    }
}

/// Names of the files of a folder that exist in place or as copies, in order.
pub(crate) fn names(folder: &Folder, path: &Path) -> Result<Vec<String>, LakeError> {
    let mut names = names_in(path)?;
    names.extend(names_in(&folder.copy_of(path))?);
    names.sort();
    names.dedup();
    Ok(names)
}

/// Removes a file and its copy.
pub(crate) fn remove(folder: &Folder, path: &Path) -> Result<(), LakeError> {
    atomic::remove_if_there(path)?;
    atomic::remove_if_there(&folder.copy_of(path))
}

/// Restores a lost or damaged file from its copy, or the copy from the file. Returns whether one of
/// them was intact.
pub(crate) fn repair(
    folder: &Folder,
    path: &Path,
    is_intact: impl Fn(&Path, &[u8]) -> bool,
) -> Result<bool, LakeError> {
    let copy = folder.copy_of(path);
    let (there, copied) = (atomic::read_if_there(path)?, atomic::read_if_there(&copy)?);
    let is_whole = |bytes: &Option<Vec<u8>>| bytes.as_ref().is_some_and(|b| is_intact(path, b));
    match (&there, &copied) {
        (Some(bytes), _) if is_whole(&there) => {
            if copied.as_ref() != Some(bytes) {
                folder.write(&copy, bytes)?;
            }
        }
        (_, Some(bytes)) if is_whole(&copied) => folder.write(path, bytes)?,
        _ => return Ok(false),
    }
    Ok(true)
}
