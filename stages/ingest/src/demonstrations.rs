//! From a parsed recording to the reach that later stages learn from.

use nalgebra::{Point3, Unit, Vector3};
use schemas::demonstrations::{Demonstration, Step};
use spatial::{Object, Pose, Rest, World};

use crate::{
    config::IngestConfig,
    error::Unusable,
    recording::{Keypoints, Recording, Tag},
    still::{self, Rule},
};

/// What tells a demonstration apart.
pub(crate) struct Names<'a> {
    /// The sequence's key.
    pub(crate) sequence: &'a str,
    /// Who grasped.
    pub(crate) subject: &'a str,
}

/// Cuts the reach out of a recording: from the first image with a hand to the last image before
/// the object leaves its rest, in the frame of the object as it rests.
///
/// # Errors
///
/// Fails if the recording has no reach that is long enough and seen well enough.
pub(crate) fn reach(
    recording: &Recording,
    config: &IngestConfig,
    names: &Names<'_>,
) -> Result<Demonstration, Unusable> {
    let poses: Vec<_> = recording
        .images
        .iter()
        .map(|image| image.world_from_object)
        .collect();
    let hands: Vec<Option<Keypoints>> = recording
        .images
        .iter()
        .map(|image| image.keypoints_in_world)
        .collect();
    if poses.iter().all(Option::is_none) {
        return Err(Unusable::NoObject);
    }
    let first = hands
        .iter()
        .position(Option::is_some)
        .ok_or(Unusable::NoHand)?;
    let still = still::find(&poses, &Rule::from(config)).ok_or(Unusable::NeverMoves)?;
    let n_steps = still
        .last
        .map_or(0, |last| (last + 1).saturating_sub(first));
    if n_steps < config.min_steps_n {
        return Err(Unusable::TooShort {
            found: n_steps,
            min: config.min_steps_n,
        });
    }
    let object_from_world = still.world_from_object.inverse();
    let mut steps = Vec::with_capacity(n_steps);
    for (step, image) in (first..).take(n_steps).enumerate() {
        let in_world = bridged(&hands, image, config.max_gap_n)?;
        steps.push(Step {
            image: u32::try_from(image).unwrap_or(u32::MAX),
            time_s: step as f64 / config.rate_hz,
            keypoints_m: in_world.map(|point| object_from_world.point(&point).into()),
        });
    }
    Ok(Demonstration {
        sequence: names.sequence.to_owned(),
        object: recording.object.clone(),
        subject: names.subject.to_owned(),
        rest: rest(&recording.world_from_tag, &still.world_from_object),
        steps,
    })
}

impl From<&IngestConfig> for Rule {
    fn from(config: &IngestConfig) -> Self {
        Self {
            threshold_m: config.move_threshold_m,
            threshold_rad: config.move_threshold_rad,
            jitter_factor: config.jitter_factor,
            settle_n: config.settle_n,
        }
    }
}

/// Returns how an object lies on the table whose surface is the tag's plane.
fn rest(world_from_tag: &Pose<World, Tag>, world_from_object: &Pose<World, Object>) -> Rest {
    let tag_from_object = &world_from_tag.inverse() * world_from_object;
    let up_in_object = tag_from_object.inverse().direction(&Vector3::z());
    Rest {
        up_in_object: Unit::new_normalize(up_in_object),
        height_m: tag_from_object.isometry().translation.z,
    }
}

/// Returns the hand in an image, or between its neighbors in time where it is not seen.
fn bridged(
    hands: &[Option<Keypoints>],
    image: usize,
    max_gap_n: usize,
) -> Result<Keypoints, Unusable> {
    let seen = |idx: usize| hands.get(idx).copied().flatten();
    if let Some(hand) = seen(image) {
        return Ok(hand);
    }
    let before = (0..image).rev().find_map(|idx| Some((idx, seen(idx)?)));
    let after = (image..hands.len()).find_map(|idx| Some((idx, seen(idx)?)));
    let start = before.map_or(0, |(idx, _)| idx + 1);
    let end = after.map_or(hands.len(), |(idx, _)| idx);
    let (Some((_, before)), Some((_, after)), true) = (before, after, end - start <= max_gap_n)
    else {
        return Err(Unusable::Gap {
            image: start,
            found: end - start,
            max: max_gap_n,
        });
    };
    let share = (image + 1 - start) as f64 / (end + 1 - start) as f64;
    let mut between = before;
    for (point, after) in between.iter_mut().zip(&after) {
        *point = Point3::from(point.coords.lerp(&after.coords, share));
    }
    Ok(between)
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use crate::{config::Hand, recording::Observation};

    fn config() -> IngestConfig {
        IngestConfig {
            root: "data".into(),
            hand: Hand::Right,
            rate_hz: 30.0,
            move_threshold_m: 0.004,
            move_threshold_rad: 0.07,
            jitter_factor: 4.0,
            settle_n: 5,
            max_gap_n: 3,
            min_steps_n: 11,
            points_n: 100,
            max_convex_parts_n: 4,
            masses_kg: std::collections::BTreeMap::new(),
        }
    }

    /// A hand that moves 1 cm per image along x, seen from image 2 on; the object leaves after
    /// image 19. Nothing is turned; the tag lies 10 cm below the object's origin.
    fn recording() -> Recording {
        let images = (0..30)
            .map(|image| {
                let hand = Point3::new(0.01 * f64::from(image), 0.0, 1.0);
                let lift = 0.02 * f64::from((image - 19).max(0));
                let pose = Isometry3::translation(0.5, 0.0, 1.0 + lift);
                Observation {
                    keypoints_in_world: (image >= 2).then_some([hand; 21]),
                    world_from_object: Some(Pose::new(pose)),
                }
            })
            .collect();
        Recording {
            object: "025_mug".to_owned(),
            world_from_tag: Pose::new(Isometry3::translation(0.0, 0.0, 0.9)),
            images,
        }
    }

    fn reach_of(recording: &Recording) -> Result<Demonstration, Unusable> {
        let names = Names {
            sequence: "a-b",
            subject: "a",
        };
        reach(recording, &config(), &names)
    }

    #[test]
    fn reach_runs_from_the_first_hand_to_the_last_still_image() {
        let reach = reach_of(&recording()).unwrap();
        assert_eq!(reach.steps.len(), 18);
        assert_eq!((reach.steps[0].image, reach.steps[17].image), (2, 19));
        assert!((reach.steps[17].time_s - 17.0 / 30.0).abs() < 1e-12);
        assert!((reach.steps[17].keypoints_m[0][0] - (0.19 - 0.5)).abs() < 1e-12);
        assert!((reach.rest.height_m - 0.1).abs() < 1e-12);
        assert!((reach.rest.up_in_object.z - 1.0).abs() < 1e-12);
    }

    #[test]
    fn short_gaps_are_bridged_and_long_ones_refused() {
        let mut recording = recording();
        for image in 10..13 {
            recording.images[image].keypoints_in_world = None;
        }
        let reach = reach_of(&recording).unwrap();
        for (step, image) in reach.steps.iter().zip(2..) {
            let expected = 0.01 * f64::from(image) - 0.5;
            assert!((step.keypoints_m[20][0] - expected).abs() < 1e-12);
        }
        recording.images[13].keypoints_in_world = None;
        let refused = reach_of(&recording).unwrap_err().to_string();
        assert_eq!(
            refused,
            "no hand in 4 images from image 10 on, more than the 3 that are bridged"
        );
    }

    #[test]
    fn says_what_the_recording_lacks() {
        let check = |change: &dyn Fn(&mut Observation), expected: &str| {
            let mut recording = recording();
            recording.images.iter_mut().for_each(change);
            assert_eq!(reach_of(&recording).unwrap_err().to_string(), expected);
        };
        check(
            &|image| image.keypoints_in_world = None,
            "no image shows a hand",
        );
        check(
            &|image| image.world_from_object = None,
            "no image shows the grasped object",
        );
        check(
            &|image| image.world_from_object = Some(Pose::identity()),
            "the object never moves",
        );
        let mut late = recording();
        for image in &mut late.images[..12] {
            image.keypoints_in_world = None;
        }
        assert_eq!(
            reach_of(&late).unwrap_err().to_string(),
            "the reach has 8 steps, fewer than 11"
        );
    }
}
