//! `poses_o.npy`: the poses of the scene's objects in the world, by object and image.

use spatial::{Object, Pose, World, quaternion_xyzw};

use crate::npz::{NpzError, npy};

/// Poses of the scene's objects, by object and image.
pub(super) type Poses = Vec<Vec<Option<Pose<World, Object>>>>;

/// Why poses cannot be used.
pub(super) enum PosesError {
    /// The array is damaged, or another one.
    Array(NpzError),
    /// Numbers are no pose.
    Value(String),
}

/// Reads the poses, quaternion `xyzw` and then translation; `None` where an object is marked as not there: all
/// −1, or all 0.
pub(super) fn objects(bytes: &[u8], n_objects: usize, n_images: u64) -> Result<Poses, PosesError> {
    let numbers =
        npy(bytes, "poses_o", &[n_objects as u64, n_images, 7]).map_err(PosesError::Array)?;
    let (flat, _) = numbers.as_chunks::<7>();
    let n_images = usize::try_from(n_images).unwrap_or(usize::MAX).max(1);
    let of_object = |numbers: &[[f64; 7]]| numbers.iter().map(pose).collect::<Result<Vec<_>, _>>();
    flat.chunks(n_images).map(of_object).collect()
}

fn pose(numbers: &[f64; 7]) -> Result<Option<Pose<World, Object>>, PosesError> {
    #[expect(clippy::float_cmp, reason = "the marks for `not there` are exact")]
    let is_mark = |mark: f64| numbers.iter().all(|&number| number == mark);
    if is_mark(0.0) || is_mark(-1.0) {
        return Ok(None);
    }
    let [x, y, z, w, px, py, pz] = *numbers;
    let rotation = quaternion_xyzw([x, y, z, w]);
    let rotation = rotation.map_err(|err| PosesError::Value(format!("`poses_o`: {err}")))?;
    Ok(Some(Pose::from_parts([px, py, pz], rotation)))
}
