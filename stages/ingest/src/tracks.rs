//! The plainest layout, for recordings of one's own and for datasets without a reader: one archive of
//! tracks per recording.
//!
//! `SUBJECT/SEQUENCE/track.yml` says what is recorded, `SUBJECT/SEQUENCE/track.npz` holds it, both in
//! one world frame of the user's choice; `models/OBJECT/textured_simple.obj` is the object's mesh.
//!
//! | in `track.npz` | shape | meaning |
//! | --- | --- | --- |
//! | `keypoints_m` | `(images, 21, 3)` f4 or f8 | the hand's landmarks in the world; all −1 where it is not seen |
//! | `world_from_object` | `(images, 7)` f4 or f8 | `x y z qx qy qz qw`; all 0 where it is not seen |

use std::path::Path;

use dataflow::SourceFile;
use nalgebra::Point3;
use schemas::demonstrations::{KEYPOINTS, Side};
use serde::Deserialize;
use spatial::Pose;

use crate::{
    config::{IngestConfig, TableRule},
    error::{IngestError, RecordingError},
    folders::{plain, recordings, root_near},
    npz::Arrays,
    reader::{self, About, Listed, Reader, glance, those_there},
    recording::{Observation, Recording, TableSource},
    selection::Cameras,
    stage::Agreement,
    yaml,
};

/// Largest accepted `track.yml`.
const MAX_ABOUT_BYTES: u64 = 1 << 16;
/// Largest accepted `track.npz`: six minutes at 30 Hz in f8 are 6 MB.
const MAX_TRACK_BYTES: u64 = 64 << 20;
/// Maximum number of accepted images of a recording.
const MAX_IMAGES: u64 = 100_000;

const ABOUT: &str = "track.yml";
const TRACK: &str = "track.npz";

/// `track.yml`.
#[derive(Debug, Deserialize)]
struct Description {
    /// The grasped object's name, of which its mesh's folder is called.
    object: String,
    /// The hand that grasps.
    hand: Side,
    /// Number of images.
    images: u64,
    /// Pose of the table in the world, `[R|t]` row by row: z up against gravity, z = 0 its surface.
    table: Option<[f64; 12]>,
}

/// A folder of tracks.
pub(crate) struct Tracks<'a> {
    root: &'a Path,
    table: TableRule,
}

impl<'a> Tracks<'a> {
    pub(crate) fn new(config: &'a IngestConfig) -> Self {
        Self {
            root: &config.root,
            table: config.table,
        }
    }
}

impl Reader for Tracks<'_> {
    fn list(&self) -> Result<Vec<Listed>, IngestError> {
        let listed: Vec<Listed> = recordings(self.root, &[ABOUT])?
            .into_iter()
            .map(|folder| {
                let bytes = glance(&folder.path.join(ABOUT), MAX_ABOUT_BYTES);
                let description = yaml::parse::<Description>(&bytes).ok();
                let description = description
                    .filter(|description| folder.fault.is_none() && description.names_an_object());
                let marks_table = description
                    .as_ref()
                    .is_some_and(|description| self.table_of(description).is_some());
                let about = description.map(|description| description.about(&folder.subject));
                Listed::new(folder, about, marks_table)
            })
            .collect();
        if listed.is_empty() {
            return Err(IngestError::NoTracks {
                root: self.root.to_owned(),
                near: root_near(self.root, &[ABOUT]),
            });
        }
        Ok(listed)
    }

    fn files(&self, listed: &Listed, _cameras: Cameras) -> Result<Vec<SourceFile>, RecordingError> {
        let files = [(ABOUT, MAX_ABOUT_BYTES), (TRACK, MAX_TRACK_BYTES)];
        those_there(files.map(|(name, limit)| (listed.file(name), limit)))
    }

    fn description(&self) -> &'static str {
        ABOUT
    }

    fn about(&self, files: &[SourceFile]) -> Result<About, RecordingError> {
        let (file, description) = describe(files)?;
        Ok(description.about(subject(file)))
    }

    fn read(&self, files: &[SourceFile]) -> Result<Recording, RecordingError> {
        let (file, description) = describe(files)?;
        let ground = match self.table_of(&description) {
            None => TableSource::StillObject {
                others: Vec::new(),
                above: None,
            },
            Some(rows) => {
                TableSource::Tag(yaml::pose(rows).ok_or_else(|| RecordingError::Value {
                    what: "`table` is not a rotation and a translation".to_owned(),
                    file: file.name.clone(),
                })?)
            }
        };
        let About {
            subject,
            object,
            hand,
            ..
        } = description.about(subject(file));
        Ok(Recording {
            object,
            subject,
            hand,
            ground,
            images: images(files, description.images)?,
            agreement: Agreement::default(),
        })
    }
}

impl Tracks<'_> {
    /// Returns the table that the recording marks, unless it is not to be used.
    fn table_of<'d>(&self, description: &'d Description) -> Option<&'d [f64; 12]> {
        match self.table {
            TableRule::Tag => description.table.as_ref(),
            TableRule::Objects => None,
        }
    }
}

impl Description {
    /// Says whether the object's name can be that of a folder and of a partition, and leads nowhere else.
    fn names_an_object(&self) -> bool {
        !self.object.is_empty() && plain(&self.object) == self.object
    }

    fn about(&self, subject: &str) -> About {
        About {
            subject: subject.to_owned(),
            object: self.object.clone(),
            hand: self.hand,
            scene: vec![self.object.clone()],
        }
    }
}

/// Returns the subject's folder.
fn subject(file: &SourceFile) -> &str {
    file.name.split('/').next().unwrap_or_default()
}

/// Finds and reads `track.yml`.
fn describe(files: &[SourceFile]) -> Result<(&SourceFile, Description), RecordingError> {
    let file = find(files, ABOUT)?;
    let bytes = reader::read(file, MAX_ABOUT_BYTES)?;
    let description: Description = yaml::parse(&bytes).map_err(|source| RecordingError::Yaml {
        file: file.name.clone(),
        source,
    })?;
    if !description.names_an_object() {
        return Err(RecordingError::Value {
            what: format!(
                "`object` is `{}`: a name has letters, digits, `_` and `-` only",
                description.object.escape_debug()
            ),
            file: file.name.clone(),
        });
    }
    if description.images > MAX_IMAGES {
        return Err(RecordingError::Value {
            what: format!("`images` is {}, more than {MAX_IMAGES}", description.images),
            file: file.name.clone(),
        });
    }
    Ok((file, description))
}

fn find<'a>(files: &'a [SourceFile], name: &str) -> Result<&'a SourceFile, RecordingError> {
    files
        .iter()
        .find(|file| file.name.ends_with(&format!("/{name}")))
        .ok_or_else(|| RecordingError::Missing {
            file: name.to_owned(),
        })
}

/// Reads `track.npz`.
fn images(files: &[SourceFile], n_images: u64) -> Result<Vec<Observation>, RecordingError> {
    let file = find(files, TRACK)?;
    let bytes = reader::read(file, MAX_TRACK_BYTES)?;
    let npz = |source| RecordingError::Npz {
        file: file.name.clone(),
        source,
    };
    let mut arrays = Arrays::open(&bytes).map_err(npz)?;
    let hands = arrays
        .numbers("keypoints_m", &[n_images, KEYPOINTS as u64, 3])
        .map_err(npz)?;
    let poses = arrays
        .numbers("world_from_object", &[n_images, 7])
        .map_err(npz)?;
    let (hands, _) = hands.as_chunks::<{ 3 * KEYPOINTS }>();
    let (poses, _) = poses.as_chunks::<7>();
    hands
        .iter()
        .zip(poses)
        .map(|(hand, pose)| {
            let is_seen = pose.iter().any(|&number| number != 0.0);
            let pose = is_seen.then(|| Pose::from_array(*pose)).transpose();
            Ok(Observation {
                keypoints_in_world: keypoints(hand),
                cameras_n: 0,
                world_from_object: pose.map_err(|err| RecordingError::Value {
                    what: format!("`world_from_object`: {err}"),
                    file: file.name.clone(),
                })?,
            })
        })
        .collect()
}

/// Returns the landmarks, `None` if all numbers are −1: no hand.
fn keypoints(numbers: &[f64; 3 * KEYPOINTS]) -> Option<[Point3<f64>; KEYPOINTS]> {
    #[expect(clippy::float_cmp, reason = "the mark for `no hand` is exactly -1")]
    let is_marked = numbers.iter().all(|&number| number == -1.0);
    let (points, _) = numbers.as_chunks::<3>();
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (keypoint, &point) in keypoints.iter_mut().zip(points) {
        *keypoint = point.into();
    }
    (!is_marked).then_some(keypoints)
}
