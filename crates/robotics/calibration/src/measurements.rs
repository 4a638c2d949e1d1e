//! Files with measurements.

use std::{fmt, marker::PhantomData};

use serde::{
    Deserialize, Deserializer,
    de::{Error, SeqAccess, Visitor},
};
use serde_json::Value;
use spatial::Pose;

use crate::{
    calibrated::Calibration,
    error::{CalibrationError, Field},
    hand_eye::{CameraMount, PosePair, calibrate_by_poses},
    numbers::{PoseFields, point},
    touched_points::{PointPair, calibrate_by_points},
};

/// Largest file, in bytes.
pub const MAX_FILE_BYTES: usize = 4 << 20;
/// Most measurements of a file.
pub const MAX_MEASUREMENTS: usize = 2000;

/// Measurements for a calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum Measurements {
    /// Points that the robot has touched and a fixed camera has seen.
    Points(Vec<PointPair>),
    /// Poses of the flange with those of a board.
    Poses {
        /// Where the camera is.
        mount: CameraMount,
        /// The poses.
        pairs: Vec<PosePair>,
    },
}

impl Measurements {
    /// Reads the JSON of a file, as the crate's README describes it.
    ///
    /// # Errors
    ///
    /// Fails if it is larger than 4 MiB, not JSON of these fields, or if numbers are no point or pose.
    pub fn parse(bytes: &[u8]) -> Result<Self, CalibrationError> {
        if bytes.len() > MAX_FILE_BYTES {
            return Err(CalibrationError::LargeFile);
        }
        let text = std::str::from_utf8(bytes).map_err(CalibrationError::NoText)?;
        // Some editors begin a file with a mark of its encoding.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let contents: Contents = serde_json::from_str(text).map_err(CalibrationError::Json)?;
        match (contents.points, contents.poses) {
            (Some(_), None) if contents.camera == Some(CameraMount::Wrist) => {
                Err(CalibrationError::PointsOfWrist)
            }
            (Some(Entries(points)), None) => {
                let pairs = points.iter().enumerate().map(|(idx, it)| it.read(idx + 1));
                pairs.collect::<Result<_, _>>().map(Self::Points)
            }
            (None, Some(Entries(poses))) => {
                let mount = contents.camera.ok_or(CalibrationError::NoMount)?;
                let pairs = poses.iter().enumerate().map(|(idx, it)| it.read(idx + 1));
                let pairs = pairs.collect::<Result<_, _>>()?;
                Ok(Self::Poses { mount, pairs })
            }
            (None, None) => Err(CalibrationError::Kind { found: "neither" }),
            (Some(_), Some(_)) => Err(CalibrationError::Kind { found: "both" }),
        }
    }

    /// Returns the pose of the camera.
    ///
    /// # Errors
    ///
    /// Fails as [`calibrate_by_points`] and [`calibrate_by_poses`] do.
    pub fn calibrate(&self) -> Result<Calibration, CalibrationError> {
        match self {
            Self::Points(pairs) => calibrate_by_points(pairs),
            Self::Poses { mount, pairs } => calibrate_by_poses(*mount, pairs),
        }
    }
}

#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "an object with `points`, or with `camera` and `poses`"
)]
struct Contents {
    camera: Option<CameraMount>,
    points: Option<Entries<PointEntry>>,
    poses: Option<Entries<PoseEntry>>,
}

#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "an object with `in_base_m` and `in_camera_m`"
)]
struct PointEntry {
    in_base_m: Value,
    in_camera_m: Value,
}

impl PointEntry {
    fn read(&self, number: usize) -> Result<PointPair, CalibrationError> {
        let at = |field: Field| format!("point {number}: {field}");
        Ok(PointPair {
            in_base: point(&at(Field::InBase), &self.in_base_m)?,
            in_camera: point(&at(Field::InCamera), &self.in_camera_m)?,
        })
    }
}

#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "an object with `base_from_flange` and `camera_from_board`"
)]
struct PoseEntry {
    base_from_flange: PoseFields,
    camera_from_board: PoseFields,
}

impl PoseEntry {
    fn read(&self, number: usize) -> Result<PosePair, CalibrationError> {
        let at = |field: Field| format!("pose {number}: {field}");
        Ok(PosePair {
            base_from_flange: Pose::new(self.base_from_flange.read(&at(Field::Flange))?),
            camera_from_board: Pose::new(self.camera_from_board.read(&at(Field::Board))?),
        })
    }
}

/// A list whose errors name the entry.
struct Entries<T>(Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Entries<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(EntriesVisitor(PhantomData))
    }
}

struct EntriesVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for EntriesVisitor<T> {
    type Value = Entries<T>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Entries<T>, A::Error> {
        let mut entries = Vec::new();
        loop {
            let number = entries.len() + 1;
            let next = list.next_element();
            match next.map_err(|err| A::Error::custom(format!("entry {number}: {err}")))? {
                Some(entry) => entries.push(entry),
                None => return Ok(Entries(entries)),
            }
        }
    }
}
