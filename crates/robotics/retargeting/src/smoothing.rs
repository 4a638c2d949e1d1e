//! Landmarks without the jitter of the recording.

use nalgebra::{Point3, Vector3};
use posture::KEYPOINTS;

use crate::LandmarkStep;

/// Standard deviations of the kernel beyond which nothing counts.
const REACH: f64 = 3.0;
/// Times this near to the reach are within it, in seconds: the same number on both sides.
const SAME_TIME_S: f64 = 1e-6;

/// Returns the landmarks of each step, smoothed over time by a Gaussian kernel of this standard
/// deviation; as they are if it is 0.
///
/// Beyond either end the path goes on as its own point reflection in that end, so that the first
/// step and the grasp stay exactly where they are. The kernel reaches no farther than the path is
/// long, where that reflection ends.
pub(crate) fn smoothed(steps: &[LandmarkStep], deviation_s: f64) -> Vec<[[f64; 3]; KEYPOINTS]> {
    if deviation_s <= 0.0 {
        return steps.iter().map(|step| step.keypoints_m).collect();
    }
    let (Some(first), Some(last)) = (steps.first(), steps.last()) else {
        return Vec::new();
    };
    let at = |step: &LandmarkStep, keypoint: usize| {
        step.keypoints_m
            .get(keypoint)
            .map_or_else(Point3::origin, |&xyz| Point3::from(xyz))
    };
    let weight = |dt_s: f64| (-0.5 * (dt_s / deviation_s).powi(2)).exp();
    let reach_s = (REACH * deviation_s).min(last.time_s - first.time_s) + SAME_TIME_S;
    steps
        .iter()
        .map(|step| {
            std::array::from_fn(|keypoint| {
                let (mut sum, mut total) = (Vector3::zeros(), 0.0);
                let mut add = |time_s: f64, place: Point3<f64>| {
                    let dt_s = time_s - step.time_s;
                    if dt_s.abs() <= reach_s {
                        let weight = weight(dt_s);
                        sum += place.coords * weight;
                        total += weight;
                    }
                };
                for (idx, other) in steps.iter().enumerate() {
                    let place = at(other, keypoint);
                    add(other.time_s, place);
                    for (end_idx, end) in [(0, first), (steps.len() - 1, last)] {
                        if idx != end_idx {
                            let center = at(end, keypoint);
                            add(2.0 * end.time_s - other.time_s, center + (center - place));
                        }
                    }
                }
                (sum / total).into()
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps whose landmarks all lie at `x`, 30 per second.
    fn steps(x: impl Fn(f64) -> f64) -> Vec<LandmarkStep> {
        (0..40)
            .map(|image| {
                let time_s = f64::from(image) / 30.0;
                LandmarkStep {
                    time_s,
                    keypoints_m: [[x(time_s), 0.0, 1.0]; KEYPOINTS],
                }
            })
            .collect()
    }

    #[test]
    fn smoothing_removes_jitter_and_keeps_the_path() {
        let jitter = |t: f64| {
            if (t * 30.0).round() % 2.0 == 0.0 {
                0.004
            } else {
                -0.004
            }
        };
        let shown = steps(|t| 0.3 * t + jitter(t));
        let smooth = smoothed(&shown, 0.05);
        let rough = |path: &[f64]| -> f64 {
            path.windows(3)
                .map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())
                .sum()
        };
        let before: Vec<f64> = shown.iter().map(|step| step.keypoints_m[7][0]).collect();
        let after: Vec<f64> = smooth.iter().map(|keypoints| keypoints[7][0]).collect();
        assert!(rough(&after) < 0.1 * rough(&before));
        for (step, x) in shown.iter().zip(&after).skip(3).take(34) {
            assert!(
                (x - 0.3 * step.time_s).abs() < 0.003,
                "{x} at {}",
                step.time_s
            );
        }
        // Both ends are kept to the last bit of what matters.
        assert!((after[0] - before[0]).abs() < 1e-12);
        assert!((after[39] - before[39]).abs() < 1e-12);
    }

    #[test]
    fn both_ends_stay_however_wide_the_kernel_is() {
        let shown = steps(|t| t * t);
        for deviation_s in [0.3, 0.6, 100.0] {
            let smooth = smoothed(&shown, deviation_s);
            for end in [0, 39] {
                let off = smooth[end][7][0] - shown[end].keypoints_m[7][0];
                assert!(off.abs() < 1e-12, "{off} m at {end} with {deviation_s} s");
            }
        }
        assert_eq!(smoothed(&shown[..1], 0.1)[0], shown[0].keypoints_m);
    }

    #[test]
    fn straight_path_and_zero_width_are_unchanged() {
        let shown = steps(|t| 0.3 * t);
        for (step, keypoints) in shown.iter().zip(smoothed(&shown, 0.1)) {
            assert!((keypoints[3][0] - step.keypoints_m[3][0]).abs() < 1e-9);
        }
        assert_eq!(smoothed(&shown, 0.0)[5], shown[5].keypoints_m);
    }
}
