//! The interface of a dataset's reader: list recordings, name their files, parse them.
//!
//! To add a dataset, write its reader beside [`crate::dexycb`] and name it in [`Format`]: all later
//! steps work on [`Recording`].

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use dataflow::SourceFile;
use schemas::demonstrations::Side;
use serde::de::DeserializeOwned;

use crate::{
    config::{Format, IngestConfig},
    dexycb::DexYcb,
    error::{IngestError, RecordingError},
    folders::RecordingFolder,
    hocap::{self, HoCap},
    place,
    recording::Recording,
    selection::Cameras,
    tracks::Tracks,
    yaml,
};

/// Reads one layout of datasets.
pub(crate) trait Reader {
    /// Lists the recordings, ordered by name, opening small files only.
    ///
    /// # Errors
    ///
    /// Fails if a folder cannot be listed.
    fn list(&self) -> Result<Vec<ListedRecording>, IngestError>;

    /// Lists the files from which a recording is read, as seen by these cameras; opens none.
    ///
    /// # Errors
    ///
    /// Fails if a folder cannot be listed, or if something else than such a file lies in a file's place.
    fn files(
        &self,
        listed: &ListedRecording,
        cameras: Cameras,
    ) -> Result<Vec<SourceFile>, RecordingError>;

    /// Returns the name of a recording's metadata file.
    fn description(&self) -> &'static str;

    /// Returns a recording's metadata, from its files.
    ///
    /// # Errors
    ///
    /// Fails if the metadata file is damaged or missing.
    fn about(&self, files: &[SourceFile]) -> Result<About, RecordingError>;

    /// Parses a recording from its files.
    ///
    /// # Errors
    ///
    /// Fails if a file is damaged, or one without which there is no recording is missing.
    fn read(&self, files: &[SourceFile]) -> Result<Recording, RecordingError>;
}

/// Returns the reader of the configured dataset.
pub(crate) fn reader(config: &IngestConfig) -> Box<dyn Reader + '_> {
    match config.format {
        Format::DexYcb => Box::new(DexYcb::new(config)),
        Format::HoCap => Box::new(HoCap::new(config)),
        Format::Tracks => Box::new(Tracks::new(config)),
    }
}

/// A recording as its dataset lists it.
#[derive(Debug)]
pub(crate) struct ListedRecording {
    /// Key of its partition: letters, digits, `_` and `-` only, unique.
    pub(crate) key: String,
    /// Its folder relative to the dataset, e.g. `SUBJECT/SEQUENCE`.
    pub(crate) name: String,
    /// Its folder.
    pub(crate) path: PathBuf,
    /// Why it is unreadable, as detected while listing.
    pub(crate) fault: Option<RecordingError>,
    /// Its metadata; `None` if the metadata file is unusable, which is reported when the recording is
    /// read.
    pub(crate) about: Option<About>,
    /// Whether something marks the table.
    pub(crate) marks_table: bool,
    /// Its cameras' folders, in the recording's order.
    pub(crate) cameras: Vec<String>,
    /// Files outside its folder with which it is read, where they are there, and their largest accepted
    /// sizes in bytes.
    pub(crate) beside: Vec<(SourceFile, u64)>,
}

impl ListedRecording {
    /// Returns a recording of a folder alone.
    pub(crate) fn new(folder: RecordingFolder, about: Option<About>, marks_table: bool) -> Self {
        Self {
            key: folder.key,
            name: folder.name,
            path: folder.path,
            fault: folder.fault,
            about,
            marks_table,
            cameras: Vec::new(),
            beside: Vec::new(),
        }
    }

    /// Names a file of its folder.
    pub(crate) fn file(&self, name: &str) -> SourceFile {
        SourceFile::new(format!("{}/{name}", self.name), self.path.join(name))
    }
}

/// Metadata of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct About {
    /// The person who grasps.
    pub(crate) subject: String,
    /// The grasped object's name.
    pub(crate) object: String,
    /// The hand that grasps.
    pub(crate) hand: Side,
    /// Names of all objects in the scene.
    pub(crate) scene: Vec<String>,
}

/// Keeps the files that are there, of which each has its largest accepted size in bytes.
///
/// # Errors
///
/// Fails with the first that is no such file.
pub(crate) fn those_there(
    files: impl IntoIterator<Item = (SourceFile, u64)>,
) -> Result<Vec<SourceFile>, RecordingError> {
    let found = files.into_iter();
    found
        .filter_map(|(file, limit)| place::find(file, limit).transpose())
        .collect()
}

/// Largest accepted YAML file: real ones have less than 2 kB.
pub(crate) const MAX_YAML_BYTES: u64 = 1 << 20;
/// Largest accepted mesh file: the dataset's own have 1 MB.
pub(crate) const MAX_MESH_BYTES: u64 = 256 << 20;
/// Folders of the datasets' meshes.
pub(crate) const MODELS: &str = "models/";

/// Returns where an object's mesh lies, relative to a dataset.
pub(crate) fn mesh_name(format: Format, object: &str) -> String {
    let file = match format {
        Format::DexYcb | Format::Tracks => "textured_simple.obj",
        Format::HoCap => hocap::MESH,
    };
    format!("{MODELS}{object}/{file}")
}

/// Returns what a listing looks at of a small file: its bytes, none where it cannot be read or has more
/// than `limit` of them, which is reported when the recording is read.
pub(crate) fn glance(path: &Path, limit: u64) -> Vec<u8> {
    let file = SourceFile::new(String::new(), path.to_owned());
    // Opening a pipe would wait for somebody to write into it.
    if path.is_file() {
        read(&file, limit).unwrap_or_default()
    } else {
        Vec::new()
    }
}

/// Reads a file of at most `limit` bytes.
pub(crate) fn read(file: &SourceFile, limit: u64) -> Result<Vec<u8>, RecordingError> {
    let unreadable = |source| RecordingError::Unreadable {
        file: file.name.clone(),
        source,
    };
    let mut opened = File::open(&file.path).map_err(unreadable)?;
    let found = opened.metadata().map_err(unreadable)?.len();
    if found > limit {
        return Err(RecordingError::TooLarge {
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

/// Reads a YAML file.
pub(crate) fn read_yaml<T: DeserializeOwned>(file: &SourceFile) -> Result<T, RecordingError> {
    parse_yaml(&file.name, &read(file, MAX_YAML_BYTES)?)
}

/// Parses the bytes of a YAML file of this name.
pub(crate) fn parse_yaml<T: DeserializeOwned>(
    file: &str,
    bytes: &[u8],
) -> Result<T, RecordingError> {
    yaml::parse(bytes).map_err(|source| RecordingError::Yaml {
        file: file.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn listing_reads_no_large_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("meta.yml");
        fs::write(&path, "a: 1\n").unwrap();
        assert_eq!(glance(&path, 5), b"a: 1\n");
        assert!(glance(&path, 4).is_empty());
        assert!(glance(folder.path(), 5).is_empty());
        assert!(glance(&folder.path().join("no"), 5).is_empty());
    }
}
