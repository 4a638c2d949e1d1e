//! The mean of several motions.

use std::sync::Arc;

use motion::{Motion, MotionError, Step};
use nalgebra::{Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};
use schemas::trajectories::TrajectoryRates;
use spatial::{Object, Pose};

/// Steps of a mean motion: the paper's.
const STEPS: usize = 40;

/// Returns the mean of motions of one hand, at equal shares of their durations: the mean of the palm's positions, of
/// its rotations (F. L. Markley et al., "Averaging Quaternions", 2007) and of the joints' positions, in the mean time.
/// `None` without motions.
///
/// # Errors
///
/// Fails if its rates are not finite.
pub(crate) fn mean(
    motions: &[&Motion<Object, TrajectoryRates>],
) -> Result<Option<Motion<Object>>, MotionError> {
    let Some(first) = motions.first() else {
        return Ok(None);
    };
    let n = motions.len() as f64;
    let duration_s = motions
        .iter()
        .map(|motion| motion.duration_s())
        .sum::<f64>()
        / n;
    let steps = (0..STEPS).map(|idx| {
        let share = idx as f64 / (STEPS - 1) as f64;
        let at: Vec<Step<Object, ()>> = motions
            .iter()
            .map(|motion| motion.at_fraction(share))
            .collect();
        let positions = at
            .iter()
            .map(|step| step.frame_from_palm.translation.vector);
        let position = positions.sum::<Vector3<f64>>() / n;
        let rotation = mean_rotation(at.iter().map(|step| step.frame_from_palm.rotation));
        let joints = 0..first.joints().len();
        Step {
            time_s: share * duration_s,
            frame_from_palm: Pose::from_parts(position, rotation),
            q_rad: joints
                .map(|joint| at.iter().map(|step| step.q_rad[joint]).sum::<f64>() / n)
                .collect(),
            rates: (),
        }
    });
    let steps = steps.collect();
    Motion::of_joints(Arc::clone(first.joints()), steps)?
        .differentiated()
        .map(Some)
}

/// Returns the rotation whose quaternion is the eigenvector of the largest eigenvalue of the sum of all `q qᵀ`.
fn mean_rotation(rotations: impl Iterator<Item = UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    let sum = rotations.fold(Matrix4::zeros(), |sum, rotation| {
        sum + rotation.coords * rotation.coords.transpose()
    });
    let eigen = SymmetricEigen::new(sum);
    let mean = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    UnitQuaternion::from_quaternion(Quaternion::from(mean.into_owned()))
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    fn motion(x_m: f64, angle: f64, q: f64, duration_s: f64) -> Motion<Object, TrajectoryRates> {
        let step = |time_s: f64, share: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(share * x_m, 0.0, 0.1),
                Vector3::new(0.0, 0.0, angle),
            )),
            q_rad: vec![q * share],
            rates: TrajectoryRates::zero(1),
        };
        Motion::new(&["j"], vec![step(0.0, 0.0), step(duration_s, 1.0)]).unwrap()
    }

    #[test]
    fn the_mean_is_between_two_motions_in_position_rotation_joints_and_time() {
        let (one, other) = (motion(0.2, 0.1, 1.0, 1.0), motion(0.4, 0.5, 0.0, 2.0));
        let mean = mean(&[&one, &other]).unwrap().unwrap();
        assert_eq!(mean.steps().len(), STEPS);
        assert!((mean.duration_s() - 1.5).abs() < 1e-12);
        let grasp = mean.grasp();
        assert!((grasp.frame_from_palm.translation.x - 0.3).abs() < 1e-12);
        let angle = grasp.frame_from_palm.rotation.scaled_axis().z;
        assert!((angle - 0.3).abs() < 1e-9, "{angle}");
        assert!((grasp.q_rad[0] - 0.5).abs() < 1e-12);
        // 0.3 m in 1.5 s.
        let middle = &mean.steps()[20];
        assert!((middle.rates.palm_velocity.linear.x - 0.2).abs() < 1e-9);
    }

    #[test]
    fn no_motion_has_no_mean() {
        assert!(mean(&[]).unwrap().is_none());
    }
}
