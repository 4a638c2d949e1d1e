//! `pose.npz`: the poses of all objects of the scene in the world, image by image.

use dataflow::SourceFile;
use spatial::{Object, Pose, World, quaternion_xyzw};

use crate::{error::RecordingError, npz::Arrays};

/// Poses of the scene's objects, by object and image.
pub(super) type Poses = Vec<Vec<Option<Pose<World, Object>>>>;

/// Reads the poses of all objects from the bytes of `file`.
pub(super) fn objects(
    file: &SourceFile,
    bytes: &[u8],
    n_images: usize,
    n_objects: usize,
) -> Result<Poses, RecordingError> {
    let numbers = Arrays::open(bytes)
        .and_then(|mut arrays| arrays.numbers("pose_y", &[n_images as u64, n_objects as u64, 7]))
        .map_err(|source| RecordingError::Npz {
            file: file.name.clone(),
            source,
        })?;
    let (flat, _) = numbers.as_chunks::<7>();
    let mut poses = vec![Vec::with_capacity(n_images); n_objects];
    for (numbers, object) in flat.iter().zip((0..n_objects).cycle()) {
        let pose = pose(numbers).map_err(|what| RecordingError::Value {
            what: format!("`pose_y`: {what}"),
            file: file.name.clone(),
        })?;
        if let Some(poses) = poses.get_mut(object) {
            poses.push(pose);
        }
    }
    Ok(poses)
}

/// Reads a pose: quaternion `xyzw`, then translation; `None` for the dataset's marks of an object
/// that is not there: all zero, or no motion at all.
fn pose(numbers: &[f64; 7]) -> Result<Option<Pose<World, Object>>, String> {
    let [x, y, z, w, px, py, pz] = *numbers;
    if [x, y, z, px, py, pz].iter().all(|&number| number == 0.0) {
        return Ok(None);
    }
    let rotation = quaternion_xyzw([x, y, z, w]).map_err(|err| err.to_string())?;
    Ok(Some(Pose::from_parts([px, py, pz], rotation)))
}
