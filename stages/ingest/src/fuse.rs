//! Fuses the estimates of several cameras into one hand and one object.
//!
//! The medoid camera is the center; cameras that agree with it are averaged, the others are outliers.
//! If no more than half of the cameras agree, there is no estimate: the image counts as one that does
//! not show the hand or object.

use nalgebra::{Translation3, UnitQuaternion, Vector3, Vector4};
use spatial::Pose;

use crate::recording::Keypoints;

/// Meters that count as one radian in distances between poses: about the size of objects.
const METERS_PER_RADIAN: f64 = 0.1;

/// The estimate of the cameras that agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CameraConsensus<T> {
    /// The average over them.
    pub(crate) value: T,
    /// Number of cameras that agree.
    pub(crate) agreeing_n: usize,
    /// Distance of the farthest of them from their center, in meters.
    pub(crate) spread_m: f64,
}

/// Fuses the landmarks of a hand from the cameras that see it, in one frame.
///
/// Two cameras agree where their landmarks are on average at most `agreement_m` apart. `None` if no
/// camera sees it, or no more than half of those that do agree.
pub(crate) fn keypoints(
    seen: &[Keypoints],
    agreement_m: f64,
) -> Option<CameraConsensus<Keypoints>> {
    let distance = |a: &Keypoints, b: &Keypoints| {
        let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum();
        sum / a.len() as f64
    };
    fuse(seen, agreement_m, distance, |agreeing| {
        let mut mean = *agreeing.first()?.to_owned();
        for (k, point) in mean.iter_mut().enumerate() {
            let sum: Vector3<f64> = agreeing
                .iter()
                .filter_map(|hand| hand.get(k))
                .map(|point| point.coords)
                .sum();
            point.coords = sum / agreeing.len() as f64;
        }
        Some(mean)
    })
}

/// Fuses what cameras that see an object say about its pose, in one frame.
///
/// Two cameras agree where their poses are at most `agreement_m` apart, with a tenth of a meter for
/// each radian. `None` if no camera sees it, or no more than half of those that do agree.
pub(crate) fn pose<To, From>(
    seen: &[Pose<To, From>],
    agreement_m: f64,
) -> Option<CameraConsensus<Pose<To, From>>> {
    fuse(seen, agreement_m, distance_m, |agreeing| {
        let first = agreeing.first()?;
        let mut translation = Vector3::zeros();
        let mut quaternion = Vector4::zeros();
        for pose in agreeing {
            translation += pose.translation.vector;
            // A quaternion and its negative are one rotation.
            let sign = pose.rotation.coords.dot(&first.rotation.coords).signum();
            quaternion += pose.rotation.coords * sign;
        }
        let rotation = UnitQuaternion::try_new(quaternion.into(), 1e-6)?;
        let translation = Translation3::from(translation / agreeing.len() as f64);
        Some(Pose::from_parts(translation, rotation))
    })
}

/// Returns how far two poses are apart, in meters, with a tenth of a meter for each radian.
pub(crate) fn distance_m<To, From>(a: &Pose<To, From>, b: &Pose<To, From>) -> f64 {
    let translation = (a.translation.vector - b.translation.vector).norm();
    translation.max(METERS_PER_RADIAN * a.rotation.angle_to(&b.rotation))
}

fn fuse<T>(
    seen: &[T],
    agreement_m: f64,
    distance: impl Fn(&T, &T) -> f64,
    mean: impl Fn(&[&T]) -> Option<T>,
) -> Option<CameraConsensus<T>> {
    let around =
        |center: &T| -> Vec<f64> { seen.iter().map(|other| distance(center, other)).collect() };
    let first = around(seen.first()?);
    let distances = if first.iter().all(|&distance| distance <= agreement_m) {
        first
    } else {
        let total = |distances: &[f64]| distances.iter().sum::<f64>();
        seen.iter()
            .map(around)
            .min_by(|a, b| total(a).total_cmp(&total(b)))?
    };
    let agreeing: Vec<&T> = seen
        .iter()
        .zip(&distances)
        .filter_map(|(value, &distance)| (distance <= agreement_m).then_some(value))
        .collect();
    if seen.len() > 1 && 2 * agreeing.len() <= seen.len() {
        return None;
    }
    let near = distances
        .into_iter()
        .filter(|&distance| distance <= agreement_m);
    Some(CameraConsensus {
        value: mean(&agreeing)?,
        agreeing_n: agreeing.len(),
        spread_m: near.fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3};
    use spatial::{Object, World};

    use super::*;

    fn hand(x: f64) -> Keypoints {
        std::array::from_fn(|k| Point3::new(x, 0.01 * k as f64, 0.0))
    }

    #[test]
    fn agreeing_cameras_are_averaged_and_outliers_left_out() {
        let seen = [hand(0.3), hand(0.0), hand(0.002), hand(0.004), hand(-0.2)];
        let fused = keypoints(&seen, 0.01).unwrap();
        assert_eq!(fused.agreeing_n, 3);
        assert!((fused.value[7].x - 0.002).abs() < 1e-12);
        assert!((fused.spread_m - 0.002).abs() < 1e-12);
    }

    #[test]
    fn one_camera_is_used_and_two_that_disagree_are_refused() {
        assert_eq!(keypoints(&[hand(0.3)], 0.01).unwrap().value, hand(0.3));
        assert!(keypoints(&[hand(0.0), hand(0.3)], 0.01).is_none());
        assert!(keypoints(&[], 0.01).is_none());
        // Two pairs, each of one mind.
        assert!(keypoints(&[hand(0.0), hand(0.0), hand(0.3), hand(0.3)], 0.01).is_none());
    }

    #[test]
    fn poses_are_averaged_whatever_the_sign_of_their_quaternions() {
        let pose = |degrees: f64| {
            Pose::<World, Object>::new(Isometry3::new(
                Vector3::x() * degrees,
                Vector3::z() * degrees.to_radians(),
            ))
        };
        let mut turned = *pose(0.02);
        turned.rotation = UnitQuaternion::new_unchecked(-turned.rotation.into_inner());
        let fused = super::pose(&[pose(0.0), Pose::new(turned), pose(3.0)], 0.05).unwrap();
        assert_eq!(fused.agreeing_n, 2);
        assert!(distance_m(&fused.value, &pose(0.01)) < 1e-9);
    }
}
