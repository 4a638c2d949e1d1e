//! What a dataset's reader does: list recordings, name their files, parse them.
//!
//! To add a dataset, write its reader beside [`crate::dexycb`] and name it in [`Format`]: everything
//! after it works on [`Recording`].

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
};

use dataflow::SourceFile;
use schemas::demonstrations::Side;

use crate::{
    config::{Format, IngestConfig},
    dexycb::DexYcb,
    error::{IngestError, Unusable},
    recording::Recording,
    selection::Cameras,
    tracks::Tracks,
};

/// Reads one layout of datasets.
pub(crate) trait Reader {
    /// Lists the recordings, ordered by name, opening small files only.
    ///
    /// # Errors
    ///
    /// Fails if a folder cannot be listed.
    fn list(&self) -> Result<Vec<Listed>, IngestError>;

    /// Lists the files from which a recording is read, as seen by these cameras.
    ///
    /// # Errors
    ///
    /// Fails if a folder cannot be listed.
    fn files(&self, listed: &Listed, cameras: Cameras) -> Result<Vec<SourceFile>, IngestError>;

    /// Returns an object's mesh file, if the dataset has one.
    fn mesh(&self, object: &str) -> Option<SourceFile>;

    /// Returns what a recording is about, from its files.
    ///
    /// # Errors
    ///
    /// Fails if the file that says so is damaged or missing.
    fn about(&self, files: &[SourceFile]) -> Result<About, Unusable>;

    /// Parses a recording from its files.
    ///
    /// # Errors
    ///
    /// Fails if a file is damaged, or one without which there is no recording is missing.
    fn read(&self, files: &[SourceFile]) -> Result<Recording, Unusable>;
}

/// Returns the reader of the configured dataset.
pub(crate) fn reader(config: &IngestConfig) -> Box<dyn Reader + '_> {
    match config.format {
        Format::DexYcb => Box::new(DexYcb::new(config)),
        Format::Tracks => Box::new(Tracks::new(config)),
    }
}

/// A recording as its dataset lists it.
#[derive(Debug)]
pub(crate) struct Listed {
    /// Key of its partition: letters, digits, `_` and `-` only, unique.
    pub(crate) key: String,
    /// Its folder relative to the dataset, e.g. `SUBJECT/SEQUENCE`.
    pub(crate) name: String,
    /// Its folder.
    pub(crate) path: PathBuf,
    /// What it is about; `None` if the file that says so cannot be used, which is reported when the
    /// recording is read.
    pub(crate) about: Option<About>,
}

/// What a recording is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct About {
    /// Who grasps.
    pub(crate) subject: String,
    /// The grasped object's name.
    pub(crate) object: String,
    /// The hand that grasps.
    pub(crate) hand: Side,
    /// Names of all objects in the scene.
    pub(crate) scene: Vec<String>,
    /// Whether something marks the table.
    pub(crate) marks_table: bool,
}

/// Returns where an object's mesh lies, relative to a dataset.
pub(crate) fn mesh_name(object: &str) -> String {
    format!("models/{object}/textured_simple.obj")
}

/// Keys for partitions: unique, and of the characters that a key can hold.
#[derive(Debug, Default)]
pub(crate) struct Keys(BTreeSet<String>);

impl Keys {
    /// Returns a key that was not given yet, as near to `name` as can be.
    pub(crate) fn of(&mut self, name: &str) -> String {
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
pub(crate) fn folders(path: &Path) -> Result<Vec<String>, IngestError> {
    Ok(names(path)?
        .into_iter()
        .filter_map(|(name, is_folder)| is_folder.then_some(name))
        .collect())
}

/// Lists the files and folders in a folder, ordered by name, and whether each is a folder; hidden
/// names, names that are not UTF-8, links to nothing, pipes and devices are left out, and a folder that
/// does not exist is empty.
pub(crate) fn names(path: &Path) -> Result<BTreeMap<String, bool>, IngestError> {
    let list_error = |source| IngestError::List {
        path: path.to_owned(),
        source,
    };
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(BTreeMap::new()),
        Err(err) => return Err(list_error(err)),
    };
    let mut found = BTreeMap::new();
    for entry in entries {
        let entry = entry.map_err(list_error)?;
        let Ok(name) = entry.file_name().into_string() else {
            continue;
        };
        if name.starts_with('.') {
            continue;
        }
        let mut kind = entry.file_type().map_err(list_error)?;
        // Datasets are often assembled from links; only those need a look at their target.
        if kind.is_symlink() {
            let Ok(target) = fs::metadata(path.join(&name)) else {
                continue;
            };
            kind = target.file_type();
        }
        if kind.is_dir() || kind.is_file() {
            found.insert(name, kind.is_dir());
        }
    }
    Ok(found)
}

/// Returns what a listing looks at of a small file: its bytes, none where it cannot be read or has more
/// than `limit` of them, which is reported when the recording is read.
pub(crate) fn glance(path: &Path, limit: u64) -> Vec<u8> {
    let file = SourceFile {
        name: String::new(),
        path: path.to_owned(),
    };
    // Opening a pipe would wait for somebody to write into it.
    if path.is_file() {
        read(&file, limit).unwrap_or_default()
    } else {
        Vec::new()
    }
}

/// Reads a file of at most `limit` bytes.
pub(crate) fn read(file: &SourceFile, limit: u64) -> Result<Vec<u8>, Unusable> {
    let unreadable = |source| Unusable::Unreadable {
        file: file.name.clone(),
        source,
    };
    let mut opened = File::open(&file.path).map_err(unreadable)?;
    let found = opened.metadata().map_err(unreadable)?.len();
    if found > limit {
        return Err(Unusable::TooLarge {
            file: file.name.clone(),
            found,
            limit,
        });
    }
    let mut bytes = Vec::with_capacity(usize::try_from(found).unwrap_or(0) + 1);
    opened
        .by_ref()
        .take(limit)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_listing_looks_at_nothing_large() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("meta.yml");
        fs::write(&path, "a: 1\n").unwrap();
        assert_eq!(glance(&path, 5), b"a: 1\n");
        assert!(glance(&path, 4).is_empty());
        assert!(glance(folder.path(), 5).is_empty());
        assert!(glance(&folder.path().join("no"), 5).is_empty());
    }
}
