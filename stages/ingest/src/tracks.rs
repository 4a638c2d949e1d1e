//! The plainest layout, for recordings of one's own and for datasets without a reader: one archive of
//! tracks per recording.
//!
//! `SUBJECT/SEQUENCE/track.yml` says what is recorded, `SUBJECT/SEQUENCE/track.npz` holds it, both in
//! one world frame of the user's choice and in one unit of length; `models/OBJECT/textured_simple.obj` is
//! the object's mesh, in meters. Every key is known, and a fault is never passed over because an option leaves
//! the recording out.
//!
//! | in `track.npz` | shape | meaning |
//! | --- | --- | --- |
//! | `keypoints_m`, `keypoints_cm` or `keypoints_mm` | `(images, 21, 3)` f4 or f8 | the hand's landmarks in the world; −1 −1 −1 where one is not seen, and then the hand is not |
//! | `world_from_object` | `(images, 7)` f4 or f8 | `x y z qx qy qz qw`; all 0 where it is not seen |

use std::{f64::consts::PI, path::Path};

use dataflow::SourceFile;
use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use schemas::demonstrations::{KEYPOINTS, Side};
use serde::Deserialize;
use spatial::{Pose, World};

use crate::{
    config::{IngestConfig, MAX_RATE_HZ, TableRule},
    error::{IngestError, RecordingError},
    folders::{plain, recordings, root_near},
    ingest::Agreement,
    npz::{Arrays, NpzError},
    reader::{self, About, ListedRecording, Reader, glance, those_there},
    recording::{Observation, Recording, TableSource, Tag},
    selection::Cameras,
    yaml,
};

/// Largest accepted `track.yml`.
const MAX_ABOUT_BYTES: u64 = 1 << 16;
/// Largest accepted `track.npz`: six minutes at 30 Hz in f8 are 6 MB.
const MAX_TRACK_BYTES: u64 = 64 << 20;
/// Maximum number of accepted images of a recording.
const MAX_IMAGES: u64 = 100_000;
/// Shortest and longest accepted palm, from the wrist to the base of the middle finger, in meters: an infant's
/// is 40 mm long, the longest ones 120 mm. Beyond it the unit is another one.
const PALM_M: std::ops::RangeInclusive<f64> = 0.02..=0.2;
/// The wrist and the base of the middle finger among the landmarks.
const PALM: [usize; 2] = [0, 9];
/// Largest accepted difference of the length of a table's direction from 1.
const DIRECTION_TOLERANCE: f64 = 1e-3;

const ABOUT: &str = "track.yml";
const TRACK: &str = "track.npz";

/// `track.yml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// The grasped object's name, of which its mesh's folder is called.
    object: String,
    /// The hand that grasps.
    hand: Side,
    /// Number of images.
    images: u64,
    /// Images per second.
    rate_hz: Option<f64>,
    /// The unit of every length but those of the mesh.
    #[serde(default)]
    unit: LengthUnit,
    /// Pose of the table in the world, `[R|t]` row by row: z up against gravity, z = 0 its surface.
    table: Option<[f64; 12]>,
    /// The table's surface instead of its pose: the direction up, and the distance of the surface from the
    /// world's origin along it.
    table_plane: Option<[f64; 4]>,
}

/// A unit of length.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
enum LengthUnit {
    /// Meters.
    #[default]
    #[serde(rename = "m")]
    Meter,
    /// Centimeters.
    #[serde(rename = "cm")]
    Centimeter,
    /// Millimeters.
    #[serde(rename = "mm")]
    Millimeter,
}

impl LengthUnit {
    fn meters(self) -> f64 {
        match self {
            Self::Meter => 1.0,
            Self::Centimeter => 0.01,
            Self::Millimeter => 0.001,
        }
    }

    /// Name of the array of landmarks in it.
    fn keypoints(self) -> &'static str {
        match self {
            Self::Meter => "keypoints_m",
            Self::Centimeter => "keypoints_cm",
            Self::Millimeter => "keypoints_mm",
        }
    }
}

/// A folder of tracks.
pub(crate) struct Tracks<'a> {
    root: &'a Path,
    table: TableRule,
    rate_hz: Option<f64>,
}

impl<'a> Tracks<'a> {
    pub(crate) fn new(config: &'a IngestConfig) -> Self {
        Self {
            root: &config.root,
            table: config.table,
            rate_hz: config.rate_hz,
        }
    }
}

impl Reader for Tracks<'_> {
    fn list(&self) -> Result<Vec<ListedRecording>, IngestError> {
        let listed: Vec<ListedRecording> = recordings(self.root, &[ABOUT])?
            .into_iter()
            .map(|folder| {
                let bytes = glance(&folder.path.join(ABOUT), MAX_ABOUT_BYTES);
                // What is wrong with it is told when the recording is read.
                let description = self.description(ABOUT, &bytes).ok();
                let description = description.filter(|_| folder.fault.is_none());
                let marks_table = description
                    .as_ref()
                    .is_some_and(|description| self.uses_table() && description.marks_table());
                let about = description.map(|description| description.about(&folder.subject));
                ListedRecording::new(folder, about, marks_table)
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

    fn files(
        &self,
        listed: &ListedRecording,
        _cameras: Cameras,
    ) -> Result<Vec<SourceFile>, RecordingError> {
        let files = [(ABOUT, MAX_ABOUT_BYTES), (TRACK, MAX_TRACK_BYTES)];
        those_there(files.map(|(name, limit)| (listed.file(name), limit)))
    }

    fn description(&self) -> &'static str {
        ABOUT
    }

    fn about(&self, files: &[SourceFile]) -> Result<About, RecordingError> {
        let (file, description) = self.describe(files)?;
        Ok(description.about(subject(file)))
    }

    fn read(&self, files: &[SourceFile]) -> Result<Recording, RecordingError> {
        let (file, description) = self.describe(files)?;
        let track = find(files, TRACK)?;
        let bytes = reader::read(track, MAX_TRACK_BYTES)?;
        let (table, images) = parse(&file.name, &description, &track.name, &bytes)?;
        let ground = match table.filter(|_| self.uses_table()) {
            None => TableSource::StillObject {
                others: Vec::new(),
                above: None,
            },
            Some(table) => TableSource::Tag(table),
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
            rate_hz: description.rate_hz.or(self.rate_hz),
            images,
            agreement: Agreement::default(),
        })
    }
}

impl Tracks<'_> {
    /// Says whether a table that a recording marks is used.
    fn uses_table(&self) -> bool {
        match self.table {
            TableRule::Tag => true,
            TableRule::Objects => false,
        }
    }

    /// Finds and reads `track.yml`.
    fn describe<'f>(
        &self,
        files: &'f [SourceFile],
    ) -> Result<(&'f SourceFile, Description), RecordingError> {
        let file = find(files, ABOUT)?;
        let bytes = reader::read(file, MAX_ABOUT_BYTES)?;
        Ok((file, self.description(&file.name, &bytes)?))
    }

    /// Parses `track.yml`, named so in messages, and compares it with the pipeline file.
    fn description(&self, name: &str, bytes: &[u8]) -> Result<Description, RecordingError> {
        let description = description(name, bytes)?;
        match (description.rate_hz, self.rate_hz) {
            (Some(found), Some(given)) if found.total_cmp(&given).is_ne() => {
                Err(RecordingError::Value {
                    what: format!(
                        "`rate_hz` is {found}, and {given} in the pipeline file: leave it out there"
                    ),
                    file: name.to_owned(),
                })
            }
            _ => Ok(description),
        }
    }
}

impl Description {
    /// Says whether the object's name can be that of a folder and of a partition, and leads nowhere else.
    fn names_an_object(&self) -> bool {
        !self.object.is_empty() && plain(&self.object) == self.object
    }

    /// Says whether it has a table, or something in its place.
    fn marks_table(&self) -> bool {
        self.table.is_some() || self.table_plane.is_some()
    }

    /// Returns the pose of the table, if there is one, or says what is wrong with it.
    fn table(&self) -> Result<Option<Pose<World, Tag>>, String> {
        let meters = self.unit.meters();
        match (&self.table, &self.table_plane) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => Err("`table` and `table_plane` are one too many".to_owned()),
            (Some(rows), None) => {
                let pose: Option<Pose<World, Tag>> = yaml::pose(rows);
                let pose = pose.ok_or("`table` is not a rotation and a translation")?;
                let place = pose.translation.vector * meters;
                Ok(Some(Pose::from_parts(place, pose.rotation)))
            }
            (None, &Some([x, y, z, distance])) => {
                let up = Vector3::new(x, y, z);
                // A NaN fails the comparison too.
                let is_direction = (up.norm() - 1.0).abs() <= DIRECTION_TOLERANCE;
                if !(is_direction && distance.is_finite()) {
                    return Err(
                        "`table_plane` is not a direction of length 1 and a distance".to_owned(),
                    );
                }
                let up = Unit::new_normalize(up);
                let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
                let turn = UnitQuaternion::rotation_between(&Vector3::z(), &up);
                let place = up.into_inner() * distance * meters;
                Ok(Some(Pose::from_parts(
                    place,
                    turn.unwrap_or_else(half_turn),
                )))
            }
        }
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

/// Parses `track.yml`, named so in messages.
fn description(name: &str, bytes: &[u8]) -> Result<Description, RecordingError> {
    let description: Description = reader::parse_yaml(name, bytes)?;
    let value = |what: String| RecordingError::Value {
        what,
        file: name.to_owned(),
    };
    if !description.names_an_object() {
        return Err(value(format!(
            "`object` is `{}`: a name has letters, digits, `_` and `-` only",
            description.object.escape_debug()
        )));
    }
    if description.images > MAX_IMAGES {
        let images = description.images;
        return Err(value(format!(
            "`images` is {images}, more than {MAX_IMAGES}"
        )));
    }
    // A NaN is none either.
    let is_rate = |rate_hz: &f64| *rate_hz > 0.0 && *rate_hz <= MAX_RATE_HZ;
    if let Some(rate_hz) = description.rate_hz.filter(|rate_hz| !is_rate(rate_hz)) {
        return Err(value(format!(
            "`rate_hz` is {rate_hz}, and must be more than 0 and at most {MAX_RATE_HZ}"
        )));
    }
    description.table().map_err(value)?;
    Ok(description)
}

fn find<'a>(files: &'a [SourceFile], name: &str) -> Result<&'a SourceFile, RecordingError> {
    files
        .iter()
        .find(|file| file.name.ends_with(&format!("/{name}")))
        .ok_or_else(|| RecordingError::Missing {
            file: name.to_owned(),
        })
}

/// A recording's table, if it marks one, and its images.
type Track = (Option<Pose<World, Tag>>, Vec<Observation>);

/// Parses a recording from the bytes of its two files.
///
/// # Errors
///
/// Fails if one is damaged or does not fit the other.
pub(crate) fn from_bytes(about: &[u8], track: &[u8]) -> Result<Track, RecordingError> {
    parse(ABOUT, &description(ABOUT, about)?, TRACK, track)
}

/// Parses `track.npz`, and takes the table from its description.
fn parse(
    about_name: &str,
    description: &Description,
    track_name: &str,
    track: &[u8],
) -> Result<Track, RecordingError> {
    let table = description.table().map_err(|what| RecordingError::Value {
        what,
        file: about_name.to_owned(),
    })?;
    Ok((table, images(description, track_name, track)?))
}

fn images(
    description: &Description,
    file: &str,
    bytes: &[u8],
) -> Result<Vec<Observation>, RecordingError> {
    let npz = |source| fault(file, source);
    let value = |what: String| RecordingError::Value {
        what,
        file: file.to_owned(),
    };
    let (name, meters) = (description.unit.keypoints(), description.unit.meters());
    let mut arrays = Arrays::open(bytes).map_err(npz)?;
    let hands = arrays
        .numbers(name, &[description.images, KEYPOINTS as u64, 3])
        .map_err(npz)?;
    let poses = arrays
        .numbers("world_from_object", &[description.images, 7])
        .map_err(npz)?;
    let (hands, _) = hands.as_chunks::<{ 3 * KEYPOINTS }>();
    let (poses, _) = poses.as_chunks::<7>();
    hands
        .iter()
        .zip(poses)
        .enumerate()
        .map(|(image, (hand, pose))| {
            let keypoints = keypoints(hand, meters);
            let palm_m = keypoints.map(|keypoints| {
                let [wrist, middle] = PALM.map(|idx| keypoints[idx]);
                (wrist - middle).norm()
            });
            if let Some(palm_m) = palm_m.filter(|palm_m| !PALM_M.contains(palm_m)) {
                return Err(value(format!(
                    "`{name}`: in image {image} the palm is {palm_m:.3} m long, as no palm is: is `unit` right?"
                )));
            }
            let is_seen = pose.iter().any(|&number| number != 0.0);
            let [x, y, z, turn @ ..] = *pose;
            let [x, y, z] = [x, y, z].map(|length| length * meters);
            let [i, j, k, w] = turn;
            let pose = is_seen.then(|| Pose::from_array([x, y, z, i, j, k, w])).transpose();
            Ok(Observation {
                keypoints_in_world: keypoints,
                cameras_n: 0,
                world_from_object: pose.map_err(|err| value(format!("`world_from_object`: {err}")))?,
            })
        })
        .collect()
}

/// Returns why an array cannot be used, with what to write instead.
fn fault(file: &str, source: NpzError) -> RecordingError {
    match source {
        NpzError::NotFinite {
            array,
            value,
            index,
        } => RecordingError::Value {
            what: match index.as_slice() {
                [image, landmark, _] => format!(
                    "`{array}` is {value} in image {image}, landmark {landmark}: write -1 -1 -1 where a landmark is \
                     not seen,"
                ),
                index => format!(
                    "`{array}` is {value} in image {}: write seven times 0 where the object is not seen,",
                    index.first().copied().unwrap_or_default()
                ),
            },
            file: file.to_owned(),
        },
        source => RecordingError::Npz {
            file: file.to_owned(),
            source,
        },
    }
}

/// Returns the landmarks in meters, `None` if all numbers of one are −1: no hand, or not all of it.
fn keypoints(numbers: &[f64; 3 * KEYPOINTS], meters: f64) -> Option<[Point3<f64>; KEYPOINTS]> {
    let (points, _) = numbers.as_chunks::<3>();
    #[expect(clippy::float_cmp, reason = "the mark for `not there` is exactly -1")]
    let is_marked = points
        .iter()
        .any(|point| point.iter().all(|&number| number == -1.0));
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (keypoint, &point) in keypoints.iter_mut().zip(points) {
        *keypoint = Point3::from(point) * meters;
    }
    (!is_marked).then_some(keypoints)
}
