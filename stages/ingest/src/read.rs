//! The readers of outside bytes one by one, for programs that measure or attack them.
//!
//! The stage reads with these; nothing else should need them. Every one returns in bounded time and
//! memory, whatever the bytes are: that is what `stages/ingest/fuzz` tries to refute.

use spatial::{Camera, Pose, World};

pub use crate::labels::{LabelReader, Labels};
pub use crate::recording::Keypoints;
use crate::{
    RecordingError,
    departure::Rule,
    npz::{Arrays, NpzError},
    yaml::{self, Extrinsics, Meta, YamlError},
};

/// Returns the numbers of an array of exactly this shape in an `.npz` file, last axis fastest.
///
/// # Errors
///
/// Fails if the file or the array is damaged, if the array is not there, has another shape or other
/// elements than `f4` and `f8`, or holds a number that is not finite.
pub fn npz(file: &[u8], array: &str, shape: &[u64]) -> Result<Vec<f64>, NpzError> {
    Arrays::open(file)?.numbers(array, shape)
}

/// Returns the cameras' serial numbers in `meta.yml`.
///
/// # Errors
///
/// Fails if the file is not YAML, or lacks a key, or a key has another type.
pub fn meta_serials(file: &[u8]) -> Result<Vec<String>, YamlError> {
    yaml::parse(file).map(|meta: Meta| meta.serials)
}

/// Returns the pose in the world of each camera, and of the tag, in `extrinsics.yml`, in meters; what is no
/// rotation and translation is left out.
///
/// # Errors
///
/// Fails if the file is not YAML, or lacks a key, or a key has another type.
pub fn extrinsics(file: &[u8]) -> Result<Vec<Pose<World, Camera>>, YamlError> {
    let extrinsics: Extrinsics = yaml::parse(file)?;
    let rows = extrinsics.extrinsics.values();
    Ok(rows.filter_map(yaml::pose).collect())
}

/// Returns how many images of a recording in plain tracks show the hand and the object, from the bytes of
/// `track.yml` and `track.npz`.
///
/// # Errors
///
/// Fails if one is damaged or does not fit the other.
pub fn tracks(about: &[u8], track: &[u8]) -> Result<usize, RecordingError> {
    let (_, images) = crate::tracks::from_bytes(about, track)?;
    let whole = images
        .iter()
        .filter(|image| image.keypoints_in_world.is_some() && image.world_from_object.is_some());
    Ok(whole.count())
}

/// Returns the number of the object that is more than 4 mm or 4° from its rest first, in a recording of `HO-Cap`,
/// from the bytes of `meta.yaml` and `poses_o.npy`; `None` if none is.
///
/// # Errors
///
/// Fails if one is damaged or does not fit the other.
pub fn hocap(meta: &[u8], poses: &[u8]) -> Result<Option<usize>, RecordingError> {
    let rule = Rule {
        threshold_m: 0.004,
        threshold_rad: 0.07,
        jitter_factor: 4.0,
        settle_n: 5,
    };
    crate::hocap::first_moved(meta, poses, &rule)
}
