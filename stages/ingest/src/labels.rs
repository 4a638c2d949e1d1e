//! Label files: what one camera saw in one image.
//!
//! A dataset has hundreds of thousands of them, so that a reader keeps its buffers from one to the
//! next; what is read of each is `joint_3d` and `pose_y`, never the segmentation.

use std::{
    collections::BTreeSet,
    fs::File,
    io::{ErrorKind, Read},
};

use dataflow::SourceFile;
use nalgebra::Point3;
use schemas::demonstrations::KEYPOINTS;
use spatial::{Camera, Object, Pose};

use crate::{
    error::RecordingError,
    folders::{entries, plain},
    npz::{self, Arrays, NpzError, Unpacker},
    place,
    reader::{ListedRecording, those_there},
    recording::Keypoints,
    selection::Cameras,
    yaml,
};

/// Largest accepted label file in bytes: an image's segmentation alone is 0.3 MB before compression.
pub(crate) const MAX_LABEL_BYTES: u64 = MAX_LABEL_LEN as u64;
/// The same as a length in memory.
const MAX_LABEL_LEN: usize = 4 << 20;
/// The buffer for a file's bytes at first; real ones have 2 kB to 20 kB.
const BUFFER_BYTES: usize = 64 << 10;
/// Numbers of one landmark.
const AXES: usize = 3;
/// Numbers of one object's pose: `[R|t]`.
const POSE_NUMBERS: usize = 12;

/// Prefix of a dataset's label file names, which the image's number and `.npz` follow.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LabelNames(pub(crate) &'static str);

impl LabelNames {
    const END: &str = ".npz";

    /// Returns the number of the image that a file is about; `None` if it is no label.
    pub(crate) fn image(self, file: &str) -> Option<u32> {
        let digits = file.strip_prefix(self.0)?.strip_suffix(Self::END)?;
        let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        is_number.then(|| digits.parse().ok()).flatten()
    }

    /// Says whether a name was meant for a label, as far as it can be read.
    fn is_like(self, name: &[u8]) -> bool {
        name.starts_with(self.0.as_bytes()) && name.ends_with(Self::END.as_bytes())
    }

    /// Lists the files from which a recording is read: of its folder `own`, each with its largest accepted size in
    /// bytes, those beside it, and the labels in the folders of some of its cameras; as far as they are there.
    ///
    /// # Errors
    ///
    /// Fails if a camera's folder cannot be listed, or if something else than such a file lies in a file's place.
    pub(crate) fn files(
        self,
        listed: &ListedRecording,
        own: [(&str, u64); 2],
        cameras: Cameras,
    ) -> Result<Vec<SourceFile>, RecordingError> {
        let own = own.map(|(name, limit)| (listed.file(name), limit));
        let mut files = those_there(own.into_iter().chain(listed.beside.iter().cloned()))?;
        let serials = listed.cameras.iter().enumerate();
        let mut taken = BTreeSet::new();
        for (_, serial) in serials.filter(|&(number, _)| cameras.holds(number)) {
            // A camera that is named twice is reported when the recording is read.
            if plain(serial) != *serial || !taken.insert(serial) {
                continue;
            }
            files.extend(self.of_camera(listed, serial)?);
        }
        Ok(files)
    }

    /// Lists the labels in a camera's folder, ordered by name.
    fn of_camera(
        self,
        listed: &ListedRecording,
        serial: &str,
    ) -> Result<Vec<SourceFile>, RecordingError> {
        let folder = listed.file(serial);
        let unreadable = |source| RecordingError::Unreadable {
            file: folder.name.clone(),
            source,
        };
        let mut labels = Vec::new();
        for entry in entries(&folder.path).map_err(unreadable)? {
            let name = entry.file_name();
            match name.to_str() {
                Some(label) if self.image(label).is_some() => {
                    let label = listed.file(&format!("{serial}/{label}"));
                    // Of a file, asking within its folder is half as expensive as asking by its path.
                    let label = match entry.metadata() {
                        Ok(metadata) if !metadata.is_symlink() => {
                            Some(place::accept(label, &metadata, MAX_LABEL_BYTES)?)
                        }
                        Ok(_) | Err(_) => place::find(label, MAX_LABEL_BYTES)?,
                    };
                    labels.extend(label);
                }
                None if self.is_like(name.as_encoded_bytes()) => {
                    return Err(RecordingError::NotUtf8 {
                        name: format!("{}/{}", folder.name, name.to_string_lossy()),
                    });
                }
                // Images, and whatever else lies beside the labels.
                Some(_) | None => {}
            }
        }
        labels.sort_unstable_by(|a, b| a.name.cmp(&b.name));
        Ok(labels)
    }
}

/// Labels of one camera's image, in the camera's frame: x right, y down, z forward, in meters.
#[derive(Debug, Clone, PartialEq)]
pub struct Labels {
    /// The hand's landmarks; `None` where the file marks them as not there (all −1).
    pub keypoints_in_camera: Option<Keypoints>,
    /// The grasped object's pose; `None` where the file marks it as not there (all 0).
    pub camera_from_object: Option<Pose<Camera, Object>>,
}

/// Labels of one image of a camera of `HO-Cap`, in the camera's frame.
#[derive(Debug)]
pub(crate) struct HandLabels {
    /// The right and the left hand's landmarks; `None` for a hand of which one is marked as not there (all −1).
    pub(crate) hands: [Option<Keypoints>; 2],
    /// The grasped object's pose, where there is one.
    pub(crate) camera_from_object: Option<Pose<Camera, Object>>,
}

/// Reads label files one after another, in memory that is kept from one to the next.
#[derive(Debug)]
pub struct LabelReader {
    unpacker: Unpacker,
    file: Vec<u8>,
    numbers: Vec<f64>,
}

impl Default for LabelReader {
    fn default() -> Self {
        Self::new()
    }
}

impl LabelReader {
    /// Returns a reader; it holds about 0.2 MB, and never more than a file of the largest accepted
    /// size needs.
    pub fn new() -> Self {
        Self {
            unpacker: Unpacker::new(),
            file: Vec::new(),
            numbers: Vec::new(),
        }
    }

    /// Reads a label file of a scene of `n_objects` objects, of which the one at index `grasped` is
    /// grasped.
    ///
    /// # Errors
    ///
    /// Fails with the file's name if it cannot be read, has more than 4 MB, is damaged, holds
    /// arrays of other shapes or types, a number that is not finite, or a pose whose rotation is
    /// none.
    pub fn read(
        &mut self,
        file: &SourceFile,
        n_objects: usize,
        grasped: usize,
    ) -> Result<Labels, RecordingError> {
        let (mut arrays, numbers) = self.open(file)?;
        let npz = |source| damaged(file, source);
        let keypoints_in_camera = keypoints(&mut arrays, numbers).map_err(npz)?;
        let camera_from_object = match pose_rows(&mut arrays, numbers, n_objects, grasped) {
            Ok(Some(rows)) => Some(yaml::pose(&rows).ok_or_else(|| RecordingError::Value {
                what: "`pose_y` is not a rotation and a translation".to_owned(),
                file: file.name.clone(),
            })?),
            Ok(None) => None,
            Err(source) => return Err(npz(source)),
        };
        Ok(Labels {
            keypoints_in_camera,
            camera_from_object,
        })
    }

    /// Reads a label file of `HO-Cap`, of a scene of `n_objects` objects, of which the one at index `grasped` is
    /// grasped: what of both hands and of that object is there.
    ///
    /// # Errors
    ///
    /// Fails as [`LabelReader::read`] does.
    pub(crate) fn read_hands(
        &mut self,
        file: &SourceFile,
        n_objects: usize,
        grasped: usize,
    ) -> Result<HandLabels, RecordingError> {
        let (mut arrays, numbers) = self.open(file)?;
        let npz = |source| damaged(file, source);
        let shape = [2, KEYPOINTS as u64, AXES as u64];
        arrays
            .numbers_into("hand_joints_3d", &shape, numbers)
            .map_err(npz)?;
        let mut hands = numbers.as_chunks::<{ AXES * KEYPOINTS }>().0.iter();
        let mut next = || {
            let (points, _) = hands.next()?.as_chunks::<AXES>();
            #[expect(clippy::float_cmp, reason = "the mark for `not there` is exactly -1")]
            let is_there = |point: &[f64; AXES]| point.iter().any(|&number| number != -1.0);
            points.iter().all(is_there).then(|| to_keypoints(points))
        };
        let hands = [next(), next()];
        let object = match arrays.numbers_into("obj_poses", &[n_objects as u64, 4, 4], numbers) {
            Ok(()) => numbers.as_chunks::<{ POSE_NUMBERS + 4 }>().0.get(grasped),
            // Nothing but a check depends on it.
            Err(NpzError::Missing(_)) => None,
            Err(source) => return Err(npz(source)),
        };
        // The last of its four rows is 0 0 0 1; a mark for `not there` is no rotation.
        let rows = object.and_then(|matrix| matrix.first_chunk::<POSE_NUMBERS>());
        Ok(HandLabels {
            hands,
            camera_from_object: rows.and_then(yaml::pose),
        })
    }

    /// Opens a label file; returns its arrays, and the buffer for the numbers of one.
    fn open(&mut self, file: &SourceFile) -> Result<(Arrays<'_>, &mut Vec<f64>), RecordingError> {
        let len = self.fill(file)?;
        let bytes = self.file.get(..len).unwrap_or_default();
        let arrays = Arrays::open_with(bytes, &mut self.unpacker);
        let arrays = arrays.map_err(|source| damaged(file, source))?;
        Ok((arrays, &mut self.numbers))
    }

    /// Reads the file's bytes into the buffer and returns how many they are.
    ///
    /// Neither its length is asked for nor its end, as long as what was read ends as an archive
    /// does: each costs as much as reading.
    fn fill(&mut self, file: &SourceFile) -> Result<usize, RecordingError> {
        let unreadable = |source| RecordingError::Unreadable {
            file: file.name.clone(),
            source,
        };
        let mut opened = File::open(&file.path).map_err(unreadable)?;
        let mut len = 0;
        loop {
            if len == self.file.len() {
                let longer = (2 * len).clamp(BUFFER_BYTES, MAX_LABEL_LEN + 1);
                self.file.resize(longer, 0);
            }
            let room = self.file.get_mut(len..).unwrap_or_default();
            match opened.read(room) {
                Ok(0) => return Ok(len),
                Ok(n) => len += n,
                Err(err) if err.kind() == ErrorKind::Interrupted => {}
                Err(err) => return Err(unreadable(err)),
            }
            if len > MAX_LABEL_LEN {
                return Err(RecordingError::TooLarge {
                    file: file.name.clone(),
                    found: opened.metadata().map_err(unreadable)?.len(),
                    limit: MAX_LABEL_BYTES,
                });
            }
            if npz::ends_whole(self.file.get(..len).unwrap_or_default()) {
                return Ok(len);
            }
        }
    }
}

fn damaged(file: &SourceFile, source: NpzError) -> RecordingError {
    RecordingError::Npz {
        file: file.name.clone(),
        source,
    }
}

/// Returns the landmarks, `None` if all numbers are −1: no hand.
fn keypoints(
    arrays: &mut Arrays<'_>,
    numbers: &mut Vec<f64>,
) -> Result<Option<Keypoints>, NpzError> {
    arrays.numbers_into("joint_3d", &[1, KEYPOINTS as u64, AXES as u64], numbers)?;
    #[expect(clippy::float_cmp, reason = "the mark for `no hand` is exactly -1")]
    let is_marked = numbers.iter().all(|&number| number == -1.0);
    if is_marked {
        return Ok(None);
    }
    Ok(Some(to_keypoints(numbers.as_chunks::<AXES>().0)))
}

fn to_keypoints(points: &[[f64; AXES]]) -> Keypoints {
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (keypoint, xyz) in keypoints.iter_mut().zip(points) {
        *keypoint = Point3::from(*xyz);
    }
    keypoints
}

/// Returns the grasped object's `[R|t]`, row by row, `None` if all numbers are 0: no object.
fn pose_rows(
    arrays: &mut Arrays<'_>,
    numbers: &mut Vec<f64>,
    n_objects: usize,
    grasped: usize,
) -> Result<Option<[f64; POSE_NUMBERS]>, NpzError> {
    arrays.numbers_into("pose_y", &[n_objects as u64, 3, 4], numbers)?;
    let rows = numbers.as_chunks::<POSE_NUMBERS>().0.get(grasped).copied();
    Ok(rows.filter(|rows| rows.iter().any(|&number| number != 0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_known_by_their_number() {
        let image = |file| LabelNames("labels_").image(file);
        assert_eq!(image("labels_000012.npz"), Some(12));
        assert_eq!(image("labels_.npz"), None);
        assert_eq!(image("labels_+00001.npz"), None);
        assert_eq!(image("labels_99999999999.npz"), None);
        assert_eq!(image("color_000012.jpg"), None);
        assert_eq!(image("label_000012.npz"), None);
    }
}
