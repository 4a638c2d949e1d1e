//! The dataset's folders: which recordings there are and which files belong to each.
//!
//! Folders are listed; `meta.yml` and the calibrations are read for what a recording is about;
//! nothing else is opened. Names that are not UTF-8 belong to no recording.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use dataflow::SourceFile;

use super::{DexYcb, MAX_YAML_BYTES};
use crate::{
    config::TableRule,
    dexycb::{
        calibration::{self, TAG},
        hand_model,
    },
    error::IngestError,
    folders::{RecordingFolder, names, plain, recordings},
    reader::{About, Listed, glance},
    selection::Cameras,
    yaml::{self, Extrinsics, Meta},
    ycb,
};

/// Marks a recording whose `pose_m` holds something else than a hand model's numbers.
const NOT_MANO: &str = "NOT_MANO.txt";
/// Folders beside the subjects' ones.
const NOT_SUBJECTS: [&str; 2] = ["calibration", "models"];

/// Lists the recordings, ordered by name.
pub(super) fn list(root: &Path, table: TableRule) -> Result<Vec<Listed>, IngestError> {
    let mut tags = BTreeMap::new();
    let folders = recordings(root, &["meta.yml", "pose.npz"])?;
    let is_subject = |folder: &RecordingFolder| !NOT_SUBJECTS.contains(&folder.subject.as_str());
    let listed: Vec<Listed> = folders
        .into_iter()
        .filter(is_subject)
        .map(|folder| {
            let bytes = glance(&folder.path.join("meta.yml"), MAX_YAML_BYTES);
            let meta = yaml::parse::<Meta>(&bytes).ok();
            let meta = meta.filter(|_| folder.fault.is_none());
            let about = meta.and_then(|meta| {
                let marks_table = *tags
                    .entry(meta.extrinsics.clone())
                    .or_insert_with(|| table == TableRule::Tag && has_tag(root, &meta.extrinsics));
                about(&folder.subject, &meta, marks_table)
            });
            Listed::new(folder, about)
        })
        .collect();
    if listed.is_empty() {
        return Err(IngestError::NoSequences {
            root: root.to_owned(),
        });
    }
    Ok(listed)
}

/// Returns what a recording is about; `None` where `meta.yml` names what there is not.
pub(super) fn about(subject: &str, meta: &Meta, marks_table: bool) -> Option<About> {
    let name = |number: u32| ycb::name(number).map(str::to_owned);
    Some(About {
        subject: subject.to_owned(),
        object: name(*meta.ycb_ids.get(meta.ycb_grasp_ind)?)?,
        hand: meta.hand()?,
        scene: meta.ycb_ids.iter().filter_map(|&id| name(id)).collect(),
        marks_table,
    })
}

/// Says whether a calibration has the table's tag; one that cannot be read is taken to, and
/// reported when a recording is read.
fn has_tag(root: &Path, id: &str) -> bool {
    if plain(id) != id {
        return true;
    }
    let path = root.join(calibration::extrinsics_name(id));
    yaml::parse::<Extrinsics>(&glance(&path, MAX_YAML_BYTES))
        .map_or(true, |extrinsics| extrinsics.extrinsics.contains_key(TAG))
}

impl DexYcb<'_> {
    /// Lists the files that say something about the hand, the object and the cameras.
    pub(super) fn files_of(
        &self,
        listed: &Listed,
        cameras: Cameras,
    ) -> Result<Vec<SourceFile>, IngestError> {
        let mut files = Vec::new();
        let mut add = |name: String, path: &Path| {
            if path.is_file() {
                let path = path.to_owned();
                files.push(SourceFile { name, path });
            }
        };
        for name in ["meta.yml", "pose.npz"] {
            add(format!("{}/{name}", listed.name), &listed.path.join(name));
        }
        let bytes = glance(&listed.path.join("meta.yml"), MAX_YAML_BYTES);
        let Ok(meta) = yaml::parse::<Meta>(&bytes) else {
            return Ok(files);
        };
        // An id is part of a folder's name; one that leads elsewhere is no id.
        if plain(&meta.extrinsics) == meta.extrinsics {
            let name = calibration::extrinsics_name(&meta.extrinsics);
            add(name.clone(), &self.root.join(&name));
        }
        if let (Some(models), Some(hand)) = (self.mano_models, meta.hand())
            // What is made up is marked: its `pose_m` is no hand model's.
            && !listed.path.join(NOT_MANO).exists()
        {
            let file = hand_model::model_file(hand);
            add(format!("mano/{file}"), &models.join(file));
            if let Some(id) = meta.mano_calib.first().filter(|id| plain(id) == **id) {
                let name = hand_model::shape_name(id);
                add(name.clone(), &self.root.join(&name));
            }
        }
        let serials = meta.serials.iter().enumerate();
        let mut listed_serials = BTreeSet::new();
        for (_, serial) in serials.filter(|&(number, _)| cameras.holds(number)) {
            // A camera that is named twice is reported when the recording is read.
            if plain(serial) != *serial || !listed_serials.insert(serial) {
                continue;
            }
            let camera = listed.path.join(serial);
            for (label, is_folder) in names(&camera)? {
                if !is_folder && image_of_label(&label).is_some() {
                    files.push(SourceFile {
                        name: format!("{}/{serial}/{label}", listed.name),
                        path: camera.join(&label),
                    });
                }
            }
        }
        Ok(files)
    }
}

/// Returns the image's number of a file `labels_NNNNNN.npz`.
fn image_of_label(file: &str) -> Option<u32> {
    let digits = file.strip_prefix("labels_")?.strip_suffix(".npz")?;
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| digits.parse().ok()).flatten()
}

/// The files of one recording by what they are, from the names that [`DexYcb::files_of`] gave them.
#[derive(Debug, Default)]
pub(super) struct SequenceFiles<'a> {
    /// The subject's folder.
    pub(super) subject: String,
    /// `meta.yml`.
    pub(super) meta: Option<&'a SourceFile>,
    /// `pose.npz`.
    pub(super) poses: Option<&'a SourceFile>,
    /// `extrinsics.yml`.
    pub(super) extrinsics: Option<&'a SourceFile>,
    /// The hand model.
    pub(super) hand_model: Option<&'a SourceFile>,
    /// `mano.yml`.
    pub(super) hand_shape: Option<&'a SourceFile>,
    /// `labels_NNNNNN.npz` by camera and image.
    pub(super) labels: BTreeMap<&'a str, BTreeMap<u32, &'a SourceFile>>,
}

impl<'a> SequenceFiles<'a> {
    /// Sorts the files.
    pub(super) fn sort(files: &'a [SourceFile]) -> Self {
        let mut sorted = Self::default();
        for file in files {
            let parts: Vec<&str> = file.name.split('/').collect();
            match *parts.as_slice() {
                ["calibration", _, "extrinsics.yml"] => sorted.extrinsics = Some(file),
                ["calibration", _, "mano.yml"] => sorted.hand_shape = Some(file),
                ["mano", _] => sorted.hand_model = Some(file),
                ["calibration" | "models", ..] => {}
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
