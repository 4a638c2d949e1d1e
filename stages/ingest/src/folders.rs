//! Lists a dataset's folders by name; opens no file.

use std::{
    collections::BTreeSet,
    ffi::OsString,
    fs::{self, DirEntry},
    io,
    path::{Component, Path, PathBuf},
};

use crate::error::{IngestError, RecordingError};

/// Folders that are listed at most in search of the dataset's root.
const SEARCHED: usize = 2000;

/// The folder of a recording: `SUBJECT/SEQUENCE`.
#[derive(Debug)]
pub(crate) struct RecordingFolder {
    /// The subject's folder.
    pub(crate) subject: String,
    /// Key of its partition, unique among the folders.
    pub(crate) key: String,
    /// Its name relative to the dataset.
    pub(crate) name: String,
    /// Its path.
    pub(crate) path: PathBuf,
    /// Why its name or its folder makes it unreadable, if so.
    pub(crate) fault: Option<RecordingError>,
}

/// Lists the folders `SUBJECT/SEQUENCE` that hold one of these files, or something in its place, ordered
/// by name; one that may not be looked into is taken for a recording.
///
/// # Errors
///
/// Fails if a folder cannot be listed.
pub(crate) fn recordings(root: &Path, files: &[&str]) -> Result<Vec<RecordingFolder>, IngestError> {
    let mut found = Vec::new();
    let mut keys = Keys::default();
    for subject in subfolders(root)? {
        let subject_path = root.join(&subject);
        for sequence in subfolders(&subject_path)? {
            let path = subject_path.join(&sequence);
            let is_named = subject.to_str().is_some() && sequence.to_str().is_some();
            let (subject, sequence) = (subject.to_string_lossy(), sequence.to_string_lossy());
            let name = format!("{subject}/{sequence}");
            let fault = match holds_one(&path, files) {
                Ok(false) => continue,
                Ok(true) if is_named => None,
                Ok(true) => Some(RecordingError::NotUtf8 { name: name.clone() }),
                Err(source) => Some(RecordingError::Unreadable {
                    file: name.clone(),
                    source,
                }),
            };
            found.push(RecordingFolder {
                key: keys.of(&format!("{subject}-{sequence}")),
                name,
                subject: subject.into_owned(),
                path,
                fault,
            });
        }
    }
    Ok(found)
}

/// Says whether a folder holds one of these files, or something in its place.
fn holds_one(folder: &Path, files: &[&str]) -> io::Result<bool> {
    for file in files {
        match fs::symlink_metadata(folder.join(file)) {
            Ok(_) => return Ok(true),
            Err(err) if err.kind() == io::ErrorKind::NotFound => {}
            Err(err) => return Err(err),
        }
    }
    Ok(false)
}

/// Looks for the dataset in the neighborhood of a folder that is not its root: one that is too deep, in
/// a subject's or a recording's folder, or up to two folders too high.
pub(crate) fn root_near(root: &Path, files: &[&str]) -> Option<PathBuf> {
    let mut search = Search {
        files,
        left: SEARCHED,
    };
    if search.is_recording(root) {
        return above(root, 2);
    }
    if search.is_subject(root) {
        return above(root, 1);
    }
    let mut level = search.list(root);
    for _ in 0..2 {
        if let Some(found) = level.iter().find(|folder| search.is_root(folder)) {
            return Some(found.clone());
        }
        level = level
            .iter()
            .flat_map(|folder| search.list(folder))
            .collect();
    }
    None
}

/// Returns the folder so many levels above another.
fn above(folder: &Path, levels: usize) -> Option<PathBuf> {
    let mut last = folder.components().rev().take(levels);
    let above = folder.ancestors().nth(levels);
    match above {
        Some(above)
            if last.all(|part| matches!(part, Component::Normal(_)))
                && !above.as_os_str().is_empty() =>
        {
            Some(above.to_owned())
        }
        _ => Some(
            folder
                .canonicalize()
                .ok()?
                .ancestors()
                .nth(levels)?
                .to_owned(),
        ),
    }
}

/// A bounded search for recordings.
struct Search<'a> {
    files: &'a [&'a str],
    /// Folders that may still be listed.
    left: usize,
}

impl Search<'_> {
    /// Lists the folders in a folder; none where that cannot be done.
    fn list(&mut self, folder: &Path) -> Vec<PathBuf> {
        let Some(left) = self.left.checked_sub(1) else {
            return Vec::new();
        };
        self.left = left;
        let names = subfolders(folder).unwrap_or_default();
        names.iter().map(|name| folder.join(name)).collect()
    }

    fn is_recording(&self, folder: &Path) -> bool {
        holds_one(folder, self.files).unwrap_or(false)
    }

    fn is_subject(&mut self, folder: &Path) -> bool {
        let within = self.list(folder);
        within.iter().any(|folder| self.is_recording(folder))
    }

    fn is_root(&mut self, folder: &Path) -> bool {
        let within = self.list(folder);
        within.iter().any(|folder| self.is_subject(folder))
    }
}

/// Keys for partitions: unique, and of the characters that a key can hold.
#[derive(Debug, Default)]
struct Keys(BTreeSet<String>);

impl Keys {
    /// Returns an unused key, as similar to `name` as possible.
    fn of(&mut self, name: &str) -> String {
        let stem = plain(name);
        let mut key = stem.clone();
        let mut n = 1;
        while !self.0.insert(key.clone()) {
            n += 1;
            key = format!("{stem}-{n}");
        }
        key
    }
}

/// Returns the text with every character that a partition's key cannot hold replaced by `_`.
pub(crate) fn plain(text: &str) -> String {
    text.chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || c == '-' || c == '_' {
                c
            } else {
                '_'
            }
        })
        .collect()
}

/// Lists the folders in a folder, ordered by name; hidden ones are left out.
fn subfolders(path: &Path) -> Result<Vec<OsString>, IngestError> {
    let mut found = Vec::new();
    for entry in entries(path).map_err(list_error(path))? {
        if is_folder(&entry).map_err(list_error(path))? {
            found.push(entry.file_name());
        }
    }
    found.sort();
    Ok(found)
}

/// Lists what is in a folder and not hidden; a folder that does not exist is empty.
pub(crate) fn entries(path: &Path) -> io::Result<Vec<DirEntry>> {
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(err) => return Err(err),
    };
    let is_shown = |entry: &io::Result<DirEntry>| {
        entry.as_ref().map_or(true, |entry| {
            !entry.file_name().as_encoded_bytes().starts_with(b".")
        })
    };
    entries.filter(is_shown).collect()
}

/// Says whether something is a folder.
fn is_folder(entry: &DirEntry) -> io::Result<bool> {
    let kind = entry.file_type()?;
    // Datasets are often assembled from links; only those need a look at their target.
    Ok(kind.is_dir() || kind.is_symlink() && entry.path().is_dir())
}

fn list_error(path: &Path) -> impl Fn(io::Error) -> IngestError {
    let path = path.to_owned();
    move |source| IngestError::List {
        path: path.clone(),
        source,
    }
}
