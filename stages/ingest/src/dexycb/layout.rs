//! The dataset's folders: which recordings there are and which files belong to each.
//!
//! Folders are listed; `meta.yml` and the calibrations are read for what a recording is about;
//! nothing else is opened.

use std::{collections::BTreeMap, path::Path};

use dataflow::SourceFile;

use super::{DexYcb, MAX_POSES_BYTES};
use crate::{
    config::TableRule,
    dexycb::{
        calibration::{self, TAG},
        hand_model,
    },
    error::{IngestError, RecordingError},
    folders::{RecordingFolder, plain, recordings, root_near},
    labels::LabelNames,
    reader::{About, ListedRecording, MAX_YAML_BYTES, glance},
    selection::Cameras,
    yaml::{self, Extrinsics, Meta},
    ycb,
};

/// Says what is in a recording.
pub(super) const META: &str = "meta.yml";
/// Holds the poses of a recording's objects and hand.
const POSES: &str = "pose.npz";
/// The labels, `labels_NNNNNN.npz`.
const LABELS: LabelNames = LabelNames("labels_");
/// Marks a recording whose `pose_m` holds something else than a hand model's numbers.
const NOT_MANO: &str = "NOT_MANO.txt";
/// Folders beside the subjects' ones.
const NOT_SUBJECTS: [&str; 2] = ["calibration", "models"];

impl DexYcb<'_> {
    /// Lists the recordings, ordered by name.
    pub(super) fn listed(&self) -> Result<Vec<ListedRecording>, IngestError> {
        let mut tags = BTreeMap::new();
        let folders = recordings(self.root, &[META, POSES])?;
        let is_subject =
            |folder: &RecordingFolder| !NOT_SUBJECTS.contains(&folder.subject.as_str());
        let listed: Vec<ListedRecording> = folders
            .into_iter()
            .filter(is_subject)
            .map(|folder| {
                let bytes = glance(&folder.path.join(META), MAX_YAML_BYTES);
                let meta = yaml::parse::<Meta>(&bytes).ok();
                let Some(meta) = meta.filter(|_| folder.fault.is_none()) else {
                    return ListedRecording::new(folder, None, true);
                };
                let marks_table = self.table == TableRule::Tag
                    && *tags
                        .entry(meta.extrinsics.clone())
                        .or_insert_with(|| has_tag(self.root, &meta.extrinsics));
                let about = about(&folder.subject, &meta);
                let beside = self.beside(&folder, &meta);
                ListedRecording {
                    cameras: meta.serials,
                    beside,
                    ..ListedRecording::new(folder, about, marks_table)
                }
            })
            .collect();
        if listed.is_empty() {
            return Err(IngestError::NoSequences {
                root: self.root.to_owned(),
                near: root_near(self.root, &[META, POSES]),
            });
        }
        Ok(listed)
    }

    /// Names the calibration of a recording's cameras and of its hand, and the hand model.
    fn beside(&self, folder: &RecordingFolder, meta: &Meta) -> Vec<(SourceFile, u64)> {
        let of_dataset = |name: String| {
            let path = self.root.join(&name);
            (SourceFile::new(name, path), MAX_YAML_BYTES)
        };
        let mut files = Vec::new();
        // An id is part of a folder's name; one that leads elsewhere is not an id.
        if plain(&meta.extrinsics) == meta.extrinsics {
            files.push(of_dataset(calibration::extrinsics_name(&meta.extrinsics)));
        }
        if let (Some(models), Some(hand)) = (self.mano_models, meta.hand())
            // What is made up is marked: its `pose_m` is not a hand model's.
            && !folder.path.join(NOT_MANO).exists()
        {
            let file = hand_model::model_file(hand);
            let file = SourceFile::new(format!("mano/{file}"), models.join(file));
            files.push((file, hand_model::MAX_MODEL_BYTES));
            let id = meta.mano_calib.first().filter(|id| plain(id) == **id);
            files.extend(id.map(|id| of_dataset(hand_model::shape_name(id))));
        }
        files
    }
}

/// Lists the files that say something about the hand, the object and the cameras.
///
/// # Errors
///
/// Fails if something else than such a file lies in a file's place, or a camera's folder cannot be
/// listed.
pub(super) fn files_of(
    listed: &ListedRecording,
    cameras: Cameras,
) -> Result<Vec<SourceFile>, RecordingError> {
    let own = [(META, MAX_YAML_BYTES), (POSES, MAX_POSES_BYTES)];
    LABELS.files(listed, own, cameras)
}

/// Returns what a recording is about; `None` where `meta.yml` names what there is not.
pub(super) fn about(subject: &str, meta: &Meta) -> Option<About> {
    let name = |number: u32| ycb::name(number).map(str::to_owned);
    Some(About {
        subject: subject.to_owned(),
        object: name(*meta.ycb_ids.get(meta.ycb_grasp_ind)?)?,
        hand: meta.hand()?,
        scene: meta.ycb_ids.iter().filter_map(|&id| name(id)).collect(),
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

/// The files of one recording by what they are, from the names that [`files_of`] gave them.
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
                [subject, _, META] => {
                    subject.clone_into(&mut sorted.subject);
                    sorted.meta = Some(file);
                }
                [_, _, POSES] => sorted.poses = Some(file),
                [_, _, camera, label] => {
                    if let Some(image) = LABELS.image(label) {
                        sorted.labels.entry(camera).or_default().insert(image, file);
                    }
                }
                _ => {}
            }
        }
        sorted
    }
}
