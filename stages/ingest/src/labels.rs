//! Label files: what one camera saw in one image.
//!
//! A dataset has hundreds of thousands of them, so that a reader keeps its buffers from one to the
//! next; what is read of each is `joint_3d` and `pose_y`, never the segmentation.

use std::{
    fs::File,
    io::{ErrorKind, Read},
};

use dataflow::SourceFile;
use nalgebra::Point3;
use schemas::demonstrations::KEYPOINTS;
use spatial::{Camera, Object, Pose};

use crate::{
    error::RecordingError,
    npz::{self, Arrays, NpzError, Unpacker},
    recording::Keypoints,
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

/// What one camera saw in one image, in the camera's frame: x right, y down, z forward, in meters.
#[derive(Debug, Clone, PartialEq)]
pub struct Labels {
    /// The hand's landmarks; `None` where the file marks them as not there (all −1).
    pub keypoints_in_camera: Option<Keypoints>,
    /// The grasped object's pose; `None` where the file marks it as not there (all 0).
    pub camera_from_object: Option<Pose<Camera, Object>>,
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
        let len = self.fill(file)?;
        let bytes = self.file.get(..len).unwrap_or_default();
        let npz = |source| RecordingError::Npz {
            file: file.name.clone(),
            source,
        };
        let mut arrays = Arrays::open_with(bytes, &mut self.unpacker).map_err(npz)?;
        let numbers = &mut self.numbers;
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
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (point, xyz) in keypoints.iter_mut().zip(numbers.as_chunks::<AXES>().0) {
        *point = Point3::from(*xyz);
    }
    Ok(Some(keypoints))
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
