//! Rotations as numbers: quaternions for storage, two matrix columns for the network.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Largest accepted difference of a stored quaternion's length from one.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Four numbers that are not a rotation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("quaternion [x, y, z, w] = {numbers:?} has length {length}, expected 1")]
pub struct InvalidRotation {
    /// The numbers found.
    pub numbers: [f64; 4],
    /// Their Euclidean length.
    pub length: f64,
}

/// Builds a rotation from `[x, y, z, w]`, the only order in which this project writes them.
///
/// # Errors
///
/// Fails if the length differs from one by more than 1e-3.
pub fn quaternion_xyzw(numbers: [f64; 4]) -> Result<UnitQuaternion<f64>, InvalidRotation> {
    let [x, y, z, w] = numbers;
    let quaternion = Quaternion::from_parts(w, Vector3::new(x, y, z));
    let length = quaternion.norm();
    // A NaN length fails the comparison too.
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        Ok(UnitQuaternion::from_quaternion(quaternion))
    } else {
        Err(InvalidRotation { numbers, length })
    }
}

/// Returns a rotation as `[x, y, z, w]` with `w ≥ 0`; of a half turn, where `w = 0`, the first number that is
/// not 0 is positive.
pub fn xyzw(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    let q = rotation.quaternion();
    let leading = [q.w, q.i, q.j, q.k].into_iter().find(|x| *x != 0.0);
    let sign = if leading.is_some_and(|x| x < 0.0) {
        -1.0
    } else {
        1.0
    };
    // `+ 0.0` turns −0 into 0, so that equal rotations are equal bytes.
    [q.i, q.j, q.k, q.w].map(|number| sign * number + 0.0)
}

/// Returns the first two columns of a rotation's matrix, the first column first
/// (Zhou et al., *On the Continuity of Rotation Representations in Neural Networks*, 2019, §B).
pub fn rot6d(rotation: &UnitQuaternion<f64>) -> [f64; 6] {
    let m = rotation.to_rotation_matrix();
    let m = m.matrix();
    [m.m11, m.m21, m.m31, m.m12, m.m22, m.m32]
}

/// Returns the rotation whose first two columns lie nearest to the given ones, by Gram-Schmidt
/// (Zhou et al. 2019, §B); `None` if the columns are parallel, zero or not finite.
pub fn rotation_from_rot6d(columns: [f64; 6]) -> Option<UnitQuaternion<f64>> {
    let [a, b, c, d, e, f] = columns;
    let x = Vector3::new(a, b, c).try_normalize(1e-9)?;
    let second = Vector3::new(d, e, f);
    let y = (second - x * x.dot(&second)).try_normalize(1e-9)?;
    let matrix = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    matrix
        .iter()
        .all(|number| number.is_finite())
        .then(|| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix)))
}
