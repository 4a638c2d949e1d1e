//! Whether the robot has turned enough.

use nalgebra::{Matrix3, Vector3};

use crate::{error::CalibrationError, hand_eye::CameraMount, loops::Loop};

/// Least rotation between two poses about an axis other than the main one, in radians: 10°. With less, an error of 0.2°
/// moves the camera by a fiftieth of its distance and more.
const LEAST_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Refuses poses whose rotations are about one axis: along it the camera may be anywhere.
pub(crate) fn check_rotations(mount: CameraMount, loops: &[Loop]) -> Result<(), CalibrationError> {
    let mut turns: Vec<Vector3<f64>> = Vec::new();
    for (idx, i) in loops.iter().enumerate() {
        let later = loops.iter().skip(idx + 1);
        turns.extend(later.map(|j| (j.a.rotation.inverse() * i.a.rotation).scaled_axis()));
    }
    let scatter: Matrix3<f64> = turns.iter().map(|turn| turn * turn.transpose()).sum();
    let axis = main_axis(&scatter);
    let largest =
        |measure: &dyn Fn(&Vector3<f64>) -> f64| turns.iter().map(measure).fold(0.0, f64::max);
    let about_rad = largest(&|turn| turn.dot(&axis).abs());
    let others_rad = largest(&|turn| (turn - axis * turn.dot(&axis)).norm());
    if others_rad >= LEAST_RAD {
        return Ok(());
    }
    Err(CalibrationError::OneAxis {
        frame: match mount {
            CameraMount::Fixed => "base",
            CameraMount::Wrist => "flange",
        },
        axis: axis.into(),
        about_deg: about_rad.to_degrees(),
        others_deg: others_rad.to_degrees(),
        least_deg: LEAST_RAD.to_degrees(),
    })
}

/// Returns the axis about which most is turned, its largest number positive.
fn main_axis(scatter: &Matrix3<f64>) -> Vector3<f64> {
    let eigen = scatter.symmetric_eigen();
    let axis: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    let leading = axis.iamax();
    if axis.get(leading).is_some_and(|number| *number < 0.0) {
        -axis
    } else {
        axis
    }
}
