//! The axes along which a hand with a fixed root is shown landmarks.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use posture::Side;

use crate::LANDMARKS;

/// The wrist, and the knuckles of index and middle finger, whose plane is the palm's.
const WRIST: usize = 0;
const INDEX_KNUCKLE: usize = 5;
const MIDDLE_KNUCKLE: usize = 9;
/// Sine of the least angle between wrist and knuckles, below which they lie on a line.
const MIN_SINE: f64 = 1e-6;

/// Returns the orientation of a person's hand in the frame of its landmarks, as the library's detector defines it:
/// z from the wrist to the middle finger's knuckle, y to the thumb's side on a right hand and away from it on a left
/// one, x out of the palm's plane. `None` if the wrist and both knuckles lie on a line, or a number is not finite.
///
/// In these axes a hand with a fixed root follows landmarks: the axes are those of its root link.
pub fn wrist_axes(landmarks_m: &[[f64; 3]; LANDMARKS], side: Side) -> Option<UnitQuaternion<f64>> {
    let at = |landmark: usize| Vector3::from(landmarks_m[landmark]);
    let z = (at(MIDDLE_KNUCKLE) - at(WRIST)).try_normalize(0.0)?;
    let to_index = (at(INDEX_KNUCKLE) - at(WRIST)).try_normalize(0.0)?;
    // In the palm's plane, to the side on which the index finger is.
    let across = to_index - z * z.dot(&to_index);
    let across = across.try_normalize(MIN_SINE)?;
    let y = match side {
        Side::Right => across,
        Side::Left => -across,
    };
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]));
    let axes = UnitQuaternion::from_rotation_matrix(&axes);
    axes.coords.sum().is_finite().then_some(axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the library's `estimate_frame_from_hand_points` and `OPERATOR2MANO`, version 0.5.0.
    #[test]
    fn axes_are_those_of_the_librarys_detector() {
        let mut landmarks_m = [[0.0; 3]; LANDMARKS];
        landmarks_m[WRIST] = [0.01, -0.02, 0.03];
        landmarks_m[INDEX_KNUCKLE] = [0.03, 0.05, 0.1];
        landmarks_m[MIDDLE_KNUCKLE] = [0.0, 0.04, 0.12];
        let right = wrist_axes(&landmarks_m, Side::Right).unwrap();
        let left = wrist_axes(&landmarks_m, Side::Left).unwrap();
        let z = right * Vector3::z();
        assert!((z - Vector3::new(-0.01, 0.06, 0.09).normalize()).norm() < 1e-12);
        assert!((left * Vector3::z() - z).norm() < 1e-12);
        assert!((left * Vector3::y() + right * Vector3::y()).norm() < 1e-12);
        let to_index = Vector3::new(0.02, 0.07, 0.07);
        assert!((right * Vector3::y()).dot(&to_index) > 0.0);
        assert!((right * Vector3::x()).dot(&to_index).abs() < 1e-12);
    }

    #[test]
    fn a_hand_on_a_line_has_no_axes() {
        let mut landmarks_m = [[0.0; 3]; LANDMARKS];
        assert_eq!(wrist_axes(&landmarks_m, Side::Right), None);
        landmarks_m[INDEX_KNUCKLE] = [0.1, 0.0, 0.0];
        landmarks_m[MIDDLE_KNUCKLE] = [0.2, 0.0, 0.0];
        assert_eq!(wrist_axes(&landmarks_m, Side::Right), None);
    }
}
