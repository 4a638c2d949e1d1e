//! What lies in a dataset's folders, by name; no file is opened.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsString,
    fs::{self, DirEntry},
    io,
    path::{Path, PathBuf},
};

use crate::error::IngestError;

/// Why a recording in a folder that cannot be named is not read.
const NOT_UTF8: &str = "the name of its folder is not UTF-8: rename it";

/// The folder of a recording: `SUBJECT/SEQUENCE`.
#[derive(Debug)]
pub(crate) struct RecordingFolder {
    /// The subject's folder.
    pub(crate) subject: String,
    /// Key of its partition, unique among the folders.
    pub(crate) key: String,
    /// Its name relative to the dataset.
    pub(crate) name: String,
    /// Where it lies.
    pub(crate) path: PathBuf,
    /// Why it cannot be read, if its name is in the way.
    pub(crate) fault: Option<&'static str>,
}

/// Lists the folders `SUBJECT/SEQUENCE` that hold one of these files, ordered by name.
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
            if !files.iter().any(|file| path.join(file).is_file()) {
                continue;
            }
            let is_named = subject.to_str().is_some() && sequence.to_str().is_some();
            let (subject, sequence) = (subject.to_string_lossy(), sequence.to_string_lossy());
            found.push(RecordingFolder {
                key: keys.of(&format!("{subject}-{sequence}")),
                name: format!("{subject}/{sequence}"),
                subject: subject.into_owned(),
                path,
                fault: (!is_named).then_some(NOT_UTF8),
            });
        }
    }
    Ok(found)
}

/// Keys for partitions: unique, and of the characters that a key can hold.
#[derive(Debug, Default)]
struct Keys(BTreeSet<String>);

impl Keys {
    /// Returns a key that was not given yet, as near to `name` as can be.
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
    for entry in entries(path)? {
        if is_folder(&entry, path)? == Some(true) {
            found.push(entry.file_name());
        }
    }
    found.sort();
    Ok(found)
}

/// Lists the files and folders in a folder, ordered by name, and whether each is a folder; hidden
/// names, names that are not UTF-8, links to nothing, pipes and devices are left out, and a folder that
/// does not exist is empty.
pub(crate) fn names(path: &Path) -> Result<BTreeMap<String, bool>, IngestError> {
    let mut found = BTreeMap::new();
    for entry in entries(path)? {
        if let (Ok(name), Some(is_folder)) =
            (entry.file_name().into_string(), is_folder(&entry, path)?)
        {
            found.insert(name, is_folder);
        }
    }
    Ok(found)
}

/// Lists what is in a folder and not hidden; a folder that does not exist is empty.
fn entries(path: &Path) -> Result<Vec<DirEntry>, IngestError> {
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(err) => return Err(list_error(path)(err)),
    };
    let is_shown = |entry: &io::Result<DirEntry>| {
        entry.as_ref().map_or(true, |entry| {
            !entry.file_name().as_encoded_bytes().starts_with(b".")
        })
    };
    entries
        .filter(is_shown)
        .collect::<io::Result<_>>()
        .map_err(list_error(path))
}

/// Says whether something is a folder or a file; `None` for everything else.
fn is_folder(entry: &DirEntry, folder: &Path) -> Result<Option<bool>, IngestError> {
    let mut kind = entry.file_type().map_err(list_error(folder))?;
    // Datasets are often assembled from links; only those need a look at their target.
    if kind.is_symlink() {
        let Ok(target) = fs::metadata(entry.path()) else {
            return Ok(None);
        };
        kind = target.file_type();
    }
    Ok((kind.is_dir() || kind.is_file()).then(|| kind.is_dir()))
}

fn list_error(path: &Path) -> impl Fn(io::Error) -> IngestError {
    let path = path.to_owned();
    move |source| IngestError::List {
        path: path.clone(),
        source,
    }
}
