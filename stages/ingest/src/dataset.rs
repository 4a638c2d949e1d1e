//! The dataset's folders: which recordings there are and which files belong to each.
//!
//! Folders are listed, `meta.yml` is read for the names of the calibration and the object, nothing
//! else is opened.
//! Names that are not UTF-8 belong to no recording.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use dataflow::SourceFile;

use crate::{
    error::IngestError,
    yaml::{self, Meta},
    ycb,
};

/// Folders beside the subjects' ones.
const NOT_SUBJECTS: [&str; 2] = ["calibration", "models"];

/// One recording's folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Sequence {
    /// Key of its partition: letters, digits, `_` and `-` only, unique.
    pub(crate) key: String,
    /// Its folder relative to the dataset: `SUBJECT/SEQUENCE`.
    name: String,
    path: PathBuf,
}

/// Lists the recordings, ordered by name.
pub(crate) fn sequences(root: &Path) -> Result<Vec<Sequence>, IngestError> {
    let mut found = Vec::new();
    let mut keys = BTreeSet::new();
    for subject in folders(root)? {
        if NOT_SUBJECTS.contains(&subject.as_str()) {
            continue;
        }
        let subject_path = root.join(&subject);
        for sequence in folders(&subject_path)? {
            let path = subject_path.join(&sequence);
            if !path.join("meta.yml").is_file() && !path.join("pose.npz").is_file() {
                continue;
            }
            let stem = plain(&format!("{subject}-{sequence}"));
            let mut key = stem.clone();
            let mut n = 1;
            while !keys.insert(key.clone()) {
                n += 1;
                key = format!("{stem}-{n}");
            }
            found.push(Sequence {
                key,
                name: format!("{subject}/{sequence}"),
                path,
            });
        }
    }
    if found.is_empty() {
        return Err(IngestError::NoSequences {
            root: root.to_owned(),
        });
    }
    Ok(found)
}

impl Sequence {
    /// Lists the files that say something about the hand, the object and the cameras.
    pub(crate) fn files(&self, root: &Path) -> Result<Vec<SourceFile>, IngestError> {
        let mut files = Vec::new();
        for name in ["meta.yml", "pose.npz"] {
            let path = self.path.join(name);
            if path.is_file() {
                files.push(SourceFile {
                    name: format!("{}/{name}", self.name),
                    path,
                });
            }
        }
        for camera in folders(&self.path)? {
            let camera_path = self.path.join(&camera);
            for (label, is_folder) in names(&camera_path)? {
                if !is_folder && image_of_label(&label).is_some() {
                    files.push(SourceFile {
                        name: format!("{}/{camera}/{label}", self.name),
                        path: camera_path.join(&label),
                    });
                }
            }
        }
        for name in self.shared_files() {
            let path = root.join(&name);
            if path.is_file() {
                files.push(SourceFile { name, path });
            }
        }
        Ok(files)
    }

    /// Returns the calibration and the object's mesh, relative to the dataset; nothing where
    /// `meta.yml` is unusable, which is reported when the recording is read.
    fn shared_files(&self) -> Vec<String> {
        let bytes = fs::read(self.path.join("meta.yml")).unwrap_or_default();
        let Ok(meta) = yaml::parse::<Meta>(&bytes) else {
            return Vec::new();
        };
        let mut files = Vec::new();
        // An id is part of a folder's name; one that leads elsewhere is no id.
        if plain(&meta.extrinsics) == meta.extrinsics {
            files.push(extrinsics_name(&meta.extrinsics));
        }
        let number = meta.ycb_ids.get(meta.ycb_grasp_ind);
        files.extend(number.and_then(|&number| ycb::name(number)).map(mesh_name));
        files
    }
}

/// Returns where a calibration lies, relative to the dataset.
pub(crate) fn extrinsics_name(id: &str) -> String {
    format!("calibration/extrinsics_{id}/extrinsics.yml")
}

/// Returns where an object's mesh lies, relative to the dataset.
pub(crate) fn mesh_name(object: &str) -> String {
    format!("models/{object}/textured_simple.obj")
}

/// Returns the image's number of a file `labels_NNNNNN.npz`.
fn image_of_label(file: &str) -> Option<u32> {
    let digits = file.strip_prefix("labels_")?.strip_suffix(".npz")?;
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| digits.parse().ok()).flatten()
}

/// The files of one recording by what they are, from the names that [`Sequence::files`] gave them.
#[derive(Debug, Default)]
pub(crate) struct SequenceFiles<'a> {
    /// The subject's folder.
    pub(crate) subject: String,
    /// `meta.yml`.
    pub(crate) meta: Option<&'a SourceFile>,
    /// `pose.npz`.
    pub(crate) poses: Option<&'a SourceFile>,
    /// `extrinsics.yml`.
    pub(crate) extrinsics: Option<&'a SourceFile>,
    /// The grasped object's mesh.
    pub(crate) mesh: Option<&'a SourceFile>,
    /// `labels_NNNNNN.npz` by camera and image.
    pub(crate) labels: BTreeMap<&'a str, BTreeMap<u32, &'a SourceFile>>,
}

impl<'a> SequenceFiles<'a> {
    /// Sorts the files.
    pub(crate) fn sort(files: &'a [SourceFile]) -> Self {
        let mut sorted = Self::default();
        for file in files {
            let parts: Vec<&str> = file.name.split('/').collect();
            match *parts.as_slice() {
                ["calibration", _, _] => sorted.extrinsics = Some(file),
                ["models", _, _] => sorted.mesh = Some(file),
                [subject, _, "meta.yml"] => {
                    subject.clone_into(&mut sorted.subject);
                    sorted.meta = Some(file);
                }
                [_, _, "pose.npz"] => sorted.poses = Some(file),
                [_, _, camera, label] => {
                    if let Some(image) = image_of_label(label) {
                        sorted.labels.entry(camera).or_default().insert(image, file);
                    }
                }
                _ => {}
            }
        }
        sorted
    }
}

/// Returns the text with every character that a partition's key cannot hold replaced by `_`.
fn plain(text: &str) -> String {
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
fn folders(path: &Path) -> Result<Vec<String>, IngestError> {
    Ok(names(path)?
        .into_iter()
        .filter_map(|(name, is_folder)| is_folder.then_some(name))
        .collect())
}

/// Lists what is in a folder, ordered by name, and whether each is a folder; hidden names and
/// names that are not UTF-8 are left out, and a folder that does not exist is empty.
fn names(path: &Path) -> Result<BTreeMap<String, bool>, IngestError> {
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
        let kind = entry.file_type().map_err(list_error)?;
        // Datasets are often assembled from links; only those need a look at their target.
        let is_folder = kind.is_dir() || (kind.is_symlink() && path.join(&name).is_dir());
        found.insert(name, is_folder);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_known_by_their_number() {
        assert_eq!(image_of_label("labels_000012.npz"), Some(12));
        assert_eq!(image_of_label("labels_.npz"), None);
        assert_eq!(image_of_label("labels_+00001.npz"), None);
        assert_eq!(image_of_label("labels_99999999999.npz"), None);
        assert_eq!(image_of_label("color_000012.jpg"), None);
    }
}
