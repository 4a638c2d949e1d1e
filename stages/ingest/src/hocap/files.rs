//! The dataset's folders: which recordings there are and which files belong to each.
//!
//! Folders are listed; `meta.yaml` and `poses_o.npy` are read for what a recording is about; nothing else is
//! opened.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use dataflow::SourceFile;
use schemas::demonstrations::Side;
use serde::Deserialize;

use super::{
    MAX_CAMERAS, MAX_IMAGES, MAX_OBJECTS, MAX_POSES_BYTES,
    poses::{self, Poses, PosesError},
};
use crate::{
    error::{IngestError, RecordingError},
    folders::{plain, recordings, root_near},
    labels::LabelNames,
    reader::{About, ListedRecording, MAX_YAML_BYTES, glance, parse_yaml, read},
    selection::Cameras,
};

/// Says what is in a recording.
pub(super) const META: &str = "meta.yaml";
/// Holds the objects' poses.
pub(super) const POSES: &str = "poses_o.npy";
/// The labels, `label_NNNNNN.npz`.
const LABELS: LabelNames = LabelNames("label_");
/// An object's mesh: of its two the one with fewer triangles.
pub(crate) const MESH: &str = "cleaned_mesh_10000.obj";
/// Folders beside the subjects' ones.
const NOT_SUBJECTS: [&str; 2] = ["calibration", "models"];
/// The calibration of recordings that name none.
const EXTRINSICS: &str = "extrinsics_20231014.yaml";

/// `meta.yaml`: what one recording holds.
#[derive(Debug, Deserialize)]
pub(super) struct Meta {
    /// Images per camera.
    pub(super) num_frames: u64,
    /// Names of the objects in the scene, which are those of their meshes' folders.
    pub(super) object_ids: Vec<String>,
    /// Sides of the hands.
    pub(super) mano_sides: Vec<String>,
    /// The cameras that do not move.
    pub(super) realsense: Cams,
    /// The calibration's file.
    #[serde(default = "extrinsics")]
    extrinsics: String,
}

/// Some cameras.
#[derive(Debug, Deserialize)]
pub(super) struct Cams {
    /// Their serial numbers.
    pub(super) serials: Vec<String>,
}

fn extrinsics() -> String {
    EXTRINSICS.to_owned()
}

impl Meta {
    /// Returns the hand that is read: the only one, or of two the one that is asked for; `None` if a side is none.
    pub(super) fn hand(&self, asked: Side) -> Option<Side> {
        let sides = self.mano_sides.iter().map(|side| Side::parse(side));
        match *sides.collect::<Option<Vec<_>>>()? {
            [side] => Some(side),
            [a, b] if a != b => Some(asked),
            _ => None,
        }
    }

    /// Returns where its calibration lies, relative to the dataset.
    pub(super) fn extrinsics_name(&self) -> String {
        format!("calibration/extrinsics/{}.yaml", self.calibration())
    }

    /// Says whether the calibration's name is that of a file, and leads nowhere else.
    fn names_a_calibration(&self) -> bool {
        plain(self.calibration()) == self.calibration()
    }

    fn calibration(&self) -> &str {
        self.extrinsics.trim_end_matches(".yaml")
    }

    /// Parses the bytes of a file.
    pub(super) fn parse(file: &str, bytes: &[u8]) -> Result<Self, RecordingError> {
        let meta: Self = parse_yaml(file, bytes)?;
        match meta.fault() {
            Some(what) => Err(RecordingError::Value {
                what,
                file: file.to_owned(),
            }),
            None => Ok(meta),
        }
    }

    /// Parses the poses of its objects from the bytes of a file.
    pub(super) fn poses(&self, file: &str, bytes: &[u8]) -> Result<Poses, RecordingError> {
        let file = file.to_owned();
        poses::objects(bytes, self.object_ids.len(), self.num_frames).map_err(|err| match err {
            PosesError::Array(source) => RecordingError::Npz { file, source },
            PosesError::Value(what) => RecordingError::Value { what, file },
        })
    }

    /// Says what is wrong with it.
    fn fault(&self) -> Option<String> {
        if self.num_frames > MAX_IMAGES {
            return Some(format!(
                "`num_frames` is {}, more than {MAX_IMAGES}",
                self.num_frames
            ));
        }
        if self.object_ids.len() > MAX_OBJECTS {
            return Some(format!("{} `object_ids`", self.object_ids.len()));
        }
        if self.realsense.serials.len() > MAX_CAMERAS {
            return Some(format!("{} `serials`", self.realsense.serials.len()));
        }
        let is_name = |name: &String| !name.is_empty() && plain(name) == *name;
        if let Some(name) = self.object_ids.iter().find(|name| !is_name(name)) {
            let name = name.escape_debug();
            return Some(format!(
                "`object_ids` has `{name}`: a name has letters, digits, `_` and `-` only"
            ));
        }
        let twice = |names: &[String]| {
            let mut seen = BTreeSet::new();
            names.iter().find(|name| !seen.insert(*name)).cloned()
        };
        let twice = twice(&self.object_ids).or_else(|| twice(&self.realsense.serials));
        twice.map(|name| format!("`{name}` is named twice"))
    }
}

/// Lists the recordings, ordered by name; `about` says what each is about.
pub(super) fn listed(
    root: &Path,
    about: impl Fn(&str, &Meta, &Poses) -> Option<About>,
) -> Result<Vec<ListedRecording>, IngestError> {
    let folders = recordings(root, &[META, POSES])?;
    let folders = folders
        .into_iter()
        .filter(|folder| !NOT_SUBJECTS.contains(&folder.subject.as_str()));
    let listed: Vec<ListedRecording> = folders
        .map(|folder| {
            let bytes = glance(&folder.path.join(META), MAX_YAML_BYTES);
            let meta = Meta::parse(META, &bytes).ok();
            let Some(meta) = meta.filter(|_| folder.fault.is_none()) else {
                return ListedRecording::new(folder, None, true);
            };
            let bytes = glance(&folder.path.join(POSES), MAX_POSES_BYTES);
            let poses = meta.poses(POSES, &bytes).ok();
            let about = poses.and_then(|poses| about(&folder.subject, &meta, &poses));
            let name = meta.extrinsics_name();
            let path = root.join(&name);
            let beside = meta.names_a_calibration();
            let beside = beside.then_some((SourceFile::new(name, path), MAX_YAML_BYTES));
            ListedRecording {
                cameras: meta.realsense.serials,
                beside: beside.into_iter().collect(),
                ..ListedRecording::new(folder, about, true)
            }
        })
        .collect();
    if listed.is_empty() {
        return Err(IngestError::NoHoCap {
            root: root.to_owned(),
            near: root_near(root, &[META, POSES]),
        });
    }
    Ok(listed)
}

/// Lists the files that say something about the hand, the objects and the cameras.
///
/// # Errors
///
/// Fails if something else than such a file lies in a file's place, or a camera's folder cannot be listed.
pub(super) fn files_of(
    listed: &ListedRecording,
    cameras: Cameras,
) -> Result<Vec<SourceFile>, RecordingError> {
    let own = [(META, MAX_YAML_BYTES), (POSES, MAX_POSES_BYTES)];
    LABELS.files(listed, own, cameras)
}

/// The files of one recording by what they are, from the names that [`files_of`] gave them.
#[derive(Debug, Default)]
pub(super) struct SequenceFiles<'a> {
    /// The subject's folder.
    pub(super) subject: String,
    meta: Option<&'a SourceFile>,
    poses: Option<&'a SourceFile>,
    /// The calibration.
    pub(super) extrinsics: Option<&'a SourceFile>,
    /// `label_NNNNNN.npz` by camera and image.
    pub(super) labels: BTreeMap<&'a str, BTreeMap<u32, &'a SourceFile>>,
}

impl<'a> SequenceFiles<'a> {
    /// Sorts the files.
    pub(super) fn sort(files: &'a [SourceFile]) -> Self {
        let mut sorted = Self::default();
        for file in files {
            let parts: Vec<&str> = file.name.split('/').collect();
            match *parts.as_slice() {
                ["calibration", "extrinsics", _] => sorted.extrinsics = Some(file),
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

    /// Reads `meta.yaml`.
    pub(super) fn meta(&self) -> Result<Meta, RecordingError> {
        let file = self.meta.ok_or_else(|| RecordingError::Missing {
            file: META.to_owned(),
        })?;
        Meta::parse(&file.name, &read(file, MAX_YAML_BYTES)?)
    }

    /// Reads `poses_o.npy`.
    pub(super) fn poses(&self, meta: &Meta) -> Result<Poses, RecordingError> {
        let file = self.poses.ok_or_else(|| RecordingError::Missing {
            file: POSES.to_owned(),
        })?;
        meta.poses(&file.name, &read(file, MAX_POSES_BYTES)?)
    }

    /// Returns the error of what the metadata says.
    pub(super) fn about_meta(&self, what: String) -> RecordingError {
        let file = self.meta.map(|file| file.name.clone()).unwrap_or_default();
        RecordingError::Value { what, file }
    }

    /// Returns the error of what the objects' poses say.
    pub(super) fn about_poses(&self, what: String) -> RecordingError {
        let file = self.poses.map(|file| file.name.clone()).unwrap_or_default();
        RecordingError::Value { what, file }
    }
}
