//! Finds an object's rest pose, and the last image before it moves.
//!
//! Trackers jitter by millimeters while an object rests, and more while a hand occludes it. So the
//! rest is a median over the still images; the object has moved once it stays displaced by more than
//! its own jitter for several images; and the onset is found by going back from there while the
//! object still gets closer to its rest.

use nalgebra::{UnitQuaternion, Vector3};
use spatial::{Object, Pose, World};

/// Images at the start that are initially assumed still.
const OPENING: usize = 10;
/// Iterations of estimating the still images and their jitter from each other.
const ROUNDS: usize = 5;
/// Maximum number of rotations for a median: its time is quadratic in their number.
const MAX_CHOICES: usize = 64;
/// The jitter's multiple, relative to the rule's, below which an image counts as at rest when
/// going back to the moment of leaving.
const AT_REST_JITTER: f64 = 0.6;
/// The part of the rule's thresholds below which an image counts as at rest when going back.
const AT_REST_THRESHOLD: f64 = 0.125;
/// Maximum number of images to go back: earlier displacement is drift, not the onset.
const MAX_BACK: usize = 8;

/// When an object counts as moved.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rule {
    /// Distance from the rest, in meters.
    pub(crate) threshold_m: f64,
    /// Angle from the rest, in radians.
    pub(crate) threshold_rad: f64,
    /// Multiple of the median deviation at rest, where that is more.
    pub(crate) jitter_factor: f64,
    /// Consecutive images that must show it displaced.
    pub(crate) settle_n: usize,
}

/// An object's rest pose and its departure from it.
#[derive(Debug, Clone)]
pub(crate) struct Departure {
    /// Rest pose.
    pub(crate) world_from_object: Pose<World, Object>,
    /// The last image before it leaves; `None` if it is away from the first image on.
    pub(crate) last: Option<usize>,
    /// The first image in which it has left.
    pub(crate) left: usize,
    /// Its displacement from rest then, in meters.
    pub(crate) left_m: f64,
    /// Its rotation from rest then, in radians.
    pub(crate) left_rad: f64,
}

impl Departure {
    fn new(
        seen: &[(usize, Pose<World, Object>)],
        rest: Pose<World, Object>,
        departure: usize,
    ) -> Option<Self> {
        let (left, pose) = *seen.get(departure)?;
        let deviation = Deviation::between(&rest, &pose);
        let last = departure.checked_sub(1).and_then(|idx| seen.get(idx));
        Some(Self {
            world_from_object: rest,
            last: last.map(|&(image, _)| image),
            left,
            left_m: deviation.m,
            left_rad: deviation.rad,
        })
    }
}

/// Finds the rest as the paper's code does: the first image's pose, left in the first image in which
/// a coordinate is more than `threshold_m` from it (Ye et al., *Learning Continuous Grasping
/// Function*, 2023, released code). `None` if the object is never seen or never leaves.
pub(crate) fn released(
    poses: &[Option<Pose<World, Object>>],
    threshold_m: f64,
) -> Option<Departure> {
    let seen = seen(poses);
    let (_, rest) = *seen.first()?;
    let departure = seen.iter().position(|(_, pose)| {
        let moved = pose.translation.vector - rest.translation.vector;
        moved.amax() > threshold_m
    })?;
    Departure::new(&seen, rest, departure)
}

/// Returns the pose in the middle of all those in which an object is seen, if it is seen at all.
pub(crate) fn middle(poses: &[Option<Pose<World, Object>>]) -> Option<Pose<World, Object>> {
    median_pose(&seen(poses))
}

/// Returns the images that show the object, with its pose.
fn seen(poses: &[Option<Pose<World, Object>>]) -> Vec<(usize, Pose<World, Object>)> {
    poses
        .iter()
        .enumerate()
        .filter_map(|(image, pose)| Some((image, (*pose)?)))
        .collect()
}

/// Finds the rest; `None` if the object is never seen or never leaves.
pub(crate) fn find(poses: &[Option<Pose<World, Object>>], rule: &Rule) -> Option<Departure> {
    let seen = seen(poses);
    let mut n_still = OPENING.min(seen.len().div_ceil(3));
    let mut found = None;
    for _ in 0..ROUNDS {
        let still = seen.get(..n_still).unwrap_or(&seen);
        let rest = median_pose(still)?;
        let departure = departure(&seen, still.len(), &rest, rule)?;
        found = Some((rest, departure));
        if departure == n_still || departure == 0 {
            break;
        }
        n_still = departure;
    }
    let (rest, departure) = found?;
    Departure::new(&seen, rest, departure)
}

/// Returns the first index at which the object has left its rest.
fn departure(
    seen: &[(usize, Pose<World, Object>)],
    n_still: usize,
    rest: &Pose<World, Object>,
    rule: &Rule,
) -> Option<usize> {
    let deviations: Vec<Deviation> = seen
        .iter()
        .map(|(_, pose)| Deviation::between(rest, pose))
        .collect();
    let still = deviations.get(..n_still)?;
    let jitter = Deviation {
        m: median(still.iter().map(|d| d.m))?,
        rad: median(still.iter().map(|d| d.rad))?,
    };
    let bound = |threshold: f64, factor: f64| Deviation {
        m: (threshold * rule.threshold_m).max(factor * jitter.m),
        rad: (threshold * rule.threshold_rad).max(factor * jitter.rad),
    };
    let away = bound(1.0, rule.jitter_factor);
    let at_rest = bound(AT_REST_THRESHOLD, AT_REST_JITTER * rule.jitter_factor);
    let is_away: Vec<bool> = deviations
        .iter()
        .map(|d| d.in_units_of(&away) > 1.0)
        .collect();
    // A single image at the very end proves nothing.
    let mut idx = (0..is_away.len().checked_sub(1)?).find(|&idx| {
        is_away
            .iter()
            .skip(idx)
            .take(rule.settle_n.max(1))
            .all(|&away| away)
    })?;
    for _ in 0..MAX_BACK {
        let Some([before, here]) = idx
            .checked_sub(1)
            .and_then(|before| deviations.get(before..=idx))
        else {
            break;
        };
        let comes_nearer = before.in_units_of(&away) < here.in_units_of(&away);
        if before.in_units_of(&at_rest) <= 1.0 || !comes_nearer {
            break;
        }
        idx -= 1;
    }
    Some(idx)
}

/// Distance between two poses.
#[derive(Debug, Clone, Copy)]
struct Deviation {
    m: f64,
    rad: f64,
}

impl Deviation {
    fn between(a: &Pose<World, Object>, b: &Pose<World, Object>) -> Self {
        Self {
            m: (a.translation.vector - b.translation.vector).norm(),
            rad: a.rotation.angle_to(&b.rotation),
        }
    }

    /// Returns the larger of the two deviations relative to their bounds.
    fn in_units_of(&self, bound: &Self) -> f64 {
        (self.m / bound.m).max(self.rad / bound.rad)
    }
}

/// Returns the median of each coordinate with the rotation that is nearest to all others.
fn median_pose(poses: &[(usize, Pose<World, Object>)]) -> Option<Pose<World, Object>> {
    let coordinate = |axis: usize| median(poses.iter().map(|(_, p)| p.translation.vector[axis]));
    let translation = Vector3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?);
    let stride = poses.len().div_ceil(MAX_CHOICES).max(1);
    let rotations: Vec<UnitQuaternion<f64>> = poses
        .iter()
        .step_by(stride)
        .map(|(_, pose)| pose.rotation)
        .collect();
    let total_angle =
        |a: &UnitQuaternion<f64>| -> f64 { rotations.iter().map(|b| a.angle_to(b)).sum() };
    let (_, rotation) = rotations
        .iter()
        .map(|rotation| (total_angle(rotation), rotation))
        .min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    Some(Pose::from_parts(translation, *rotation))
}

/// Returns the median, of an even count the lower one, so that it is one of the values.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len().checked_sub(1)? / 2).copied()
}

#[cfg(test)]
mod tests {

    use nalgebra::{Isometry3, Translation3};
    use rand_chacha::{
        ChaCha8Rng,
        rand_core::{RngCore, SeedableRng},
    };

    use super::*;
    use crate::{config::IngestConfig, fixture, reader, selection::Cameras};

    const RULE: Rule = Rule {
        threshold_m: 0.004,
        threshold_rad: 0.07,
        jitter_factor: 4.0,
        settle_n: 5,
    };

    /// A rest of `n_still` images, then a lift by `lift_m` per image, with jitter in each coordinate.
    fn lifted(n_still: usize, lift_m: f64, jitter_m: f64, seed: u64) -> Vec<Isometry3<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = || {
            // The sum of twelve uniform numbers has variance one.
            let sum: f64 = (0..12)
                .map(|_| f64::from(rng.next_u32()) / f64::from(u32::MAX))
                .sum();
            jitter_m * (sum - 6.0)
        };
        (0..n_still + 20)
            .map(|image| {
                let lift = lift_m * (image + 1).saturating_sub(n_still) as f64;
                Isometry3::new(
                    Vector3::new(0.3 + noise(), noise(), 0.8 + lift + noise()),
                    Vector3::new(0.1, 0.2, 0.3),
                )
            })
            .collect()
    }

    fn all_seen(poses: Vec<Isometry3<f64>>) -> Vec<Option<Pose<World, Object>>> {
        poses
            .into_iter()
            .map(|pose| Some(Pose::new(pose)))
            .collect()
    }

    #[test]
    fn finds_the_last_still_image_of_exact_poses() {
        for lift_m in [0.0006, 0.002, 0.012, 0.05] {
            let departure = find(&all_seen(lifted(30, lift_m, 0.0, 0)), &RULE).unwrap();
            assert_eq!(departure.last, Some(29), "lift of {lift_m} m per image");
            assert_eq!(*departure.world_from_object, lifted(1, 0.0, 0.0, 0)[0]);
        }
    }

    #[test]
    fn finds_it_within_one_image_in_two_millimeters_of_jitter() {
        for seed in 0..200 {
            let last = find(&all_seen(lifted(30, 0.012, 0.002, seed)), &RULE)
                .unwrap()
                .last;
            assert!(matches!(last, Some(28..=30)), "{last:?} with seed {seed}");
        }
    }

    #[test]
    fn one_outlier_is_not_motion() {
        let mut poses = lifted(30, 0.012, 0.001, 3);
        poses[5].translation.z -= 0.027;
        poses[17].translation.x += 0.05;
        let last = find(&all_seen(poses), &RULE).unwrap().last;
        assert!(matches!(last, Some(28..=30)), "{last:?}");
    }

    #[test]
    fn a_turn_in_place_is_a_departure() {
        let mut poses = lifted(30, 0.0, 0.0, 0);
        for (n, pose) in poses.iter_mut().skip(25).enumerate() {
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.05 * (n + 1) as f64);
            pose.rotation = turn * pose.rotation;
        }
        assert_eq!(find(&all_seen(poses), &RULE).unwrap().last, Some(24));
    }

    #[test]
    fn object_at_rest_never_leaves() {
        assert!(find(&all_seen(lifted(30, 0.0, 0.002, 1)), &RULE).is_none());
        assert!(find(&[None, None], &RULE).is_none());
        assert!(find(&[], &RULE).is_none());
    }

    #[test]
    fn images_without_the_object_are_passed_over() {
        let mut poses = all_seen(lifted(30, 0.012, 0.0, 0));
        poses[12] = None;
        poses[29] = None;
        assert_eq!(find(&poses, &RULE).unwrap().last, Some(28));
    }

    #[test]
    fn the_released_rule_looks_at_each_coordinate_and_at_no_turn() {
        let mut poses = lifted(30, 0.0, 0.0, 0);
        poses[20].rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0);
        for (n, pose) in poses.iter_mut().skip(25).enumerate() {
            // 3 mm in two coordinates are 4.2 mm together, and no departure.
            let moved = if n < 3 { 0.003 } else { 0.005 };
            pose.translation.vector += Vector3::new(moved, moved, 0.0);
        }
        let departure = released(&all_seen(poses), 0.004).unwrap();
        assert_eq!((departure.last, departure.left), (Some(27), 28));
        assert!((departure.left_m - 0.005 * 2.0_f64.sqrt()).abs() < 1e-12);
        assert!(released(&all_seen(lifted(30, 0.0, 0.001, 0)), 0.01).is_none());
    }

    /// On real recordings, if `PIPELINE_REAL_DATA` names the folder that holds them: the grasp that
    /// is found in exact poses stays within an image when each coordinate gets noise of 2 mm and
    /// each axis of rotation noise of 10 mrad.
    #[test]
    fn two_millimeters_of_noise_move_the_grasp_by_an_image_at_most() {
        let Some(root) = measured_data::folder("dexycb-right") else {
            return;
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut noise = move |sd: f64| {
            let sum: f64 = (0..12)
                .map(|_| f64::from(rng.next_u32()) / f64::from(u32::MAX))
                .sum();
            sd * (sum - 6.0)
        };
        let config = IngestConfig {
            root,
            ..fixture::config()
        };
        let reader = reader::reader(&config);
        let (mut n, mut n_within) = (0, 0);
        for listed in reader.list().unwrap() {
            let files = reader.files(&listed, Cameras::ALL).unwrap();
            let recording = reader.read(&files).unwrap();
            let poses: Vec<_> = recording
                .images
                .iter()
                .map(|image| image.world_from_object)
                .collect();
            let exact = find(&poses, &RULE).unwrap().last.unwrap();
            for _ in 0..3 {
                let shaken: Vec<_> = poses
                    .iter()
                    .map(|pose| {
                        let pose = (*pose)?;
                        let mut draw = |sd| Vector3::from_fn(|_, _| noise(sd));
                        let shift = Translation3::from(draw(0.002));
                        let turn = UnitQuaternion::from_scaled_axis(draw(0.01));
                        Some(Pose::new(Isometry3::from_parts(
                            shift * pose.translation,
                            turn * pose.rotation,
                        )))
                    })
                    .collect();
                let last = find(&shaken, &RULE).and_then(|departure| departure.last);
                n += 1;
                n_within += usize::from(last.is_some_and(|last| last.abs_diff(exact) <= 1));
            }
        }
        eprintln!("{n_within} of {n} within an image");
        assert_eq!(n_within, n);
    }
}
