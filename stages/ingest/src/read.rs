//! The readers of outside bytes one by one, for programs that measure or attack them.
//!
//! The stage reads with these; nothing else should need them. Every one returns in bounded time and
//! memory, whatever the bytes are: that is what `stages/ingest/fuzz` tries to refute.

use spatial::{Camera, Pose, World};

pub use crate::labels::{LabelReader, Labels};
pub use crate::recording::Keypoints;
use crate::{
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
