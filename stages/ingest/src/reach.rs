//! Extracts the reach from a parsed recording.

use nalgebra::Point3;
use schemas::demonstrations::{Demonstration, Step};
use spatial::{Object, Pose, RestingPose, World};

use crate::{
    config::{IngestConfig, ReachRule},
    departure::{self, Departure, Rule},
    error::RecordingError,
    recording::{Keypoints, Recording},
};

/// The object's rest in a recording, and the last image before it moves.
///
/// # Errors
///
/// Fails if the object is never seen or never leaves.
pub(crate) fn departure(
    recording: &Recording,
    config: &IngestConfig,
) -> Result<Departure, RecordingError> {
    let poses = object_poses(recording);
    if poses.iter().all(Option::is_none) {
        return Err(RecordingError::NoObject);
    }
    match config.reach {
        ReachRule::Robust => departure::find(&poses, &Rule::from(config)),
        ReachRule::Released => departure::released(&poses, config.move_threshold_m),
    }
    .ok_or(RecordingError::NeverMoves)
}

fn object_poses(recording: &Recording) -> Vec<Option<Pose<World, Object>>> {
    let images = recording.images.iter();
    images.map(|image| image.world_from_object).collect()
}

/// Extracts the reach from a recording: from the first image with a hand to the last image before the
/// object moves, in the frame of the resting object.
///
/// # Errors
///
/// Fails if the recording has no reach of sufficient length and visibility.
pub(crate) fn reach(
    sequence: &str,
    recording: &Recording,
    departure: &Departure,
    rest: RestingPose,
    config: &IngestConfig,
) -> Result<Demonstration, RecordingError> {
    let hands: Vec<Option<Keypoints>> = recording
        .images
        .iter()
        .map(|image| image.keypoints_in_world)
        .collect();
    let first = hands
        .iter()
        .position(Option::is_some)
        .ok_or(RecordingError::NoHand)?;
    let n_steps = departure
        .last
        .map_or(0, |last| (last + 1).saturating_sub(first));
    if n_steps < config.min_steps_n {
        return Err(RecordingError::TooShort {
            found: n_steps,
            min: config.min_steps_n,
        });
    }
    let object_from_world = departure.world_from_object.inverse();
    let mut steps = Vec::with_capacity(n_steps);
    let images = recording.images.iter().enumerate().skip(first);
    for (step, (image, observation)) in images.take(n_steps).enumerate() {
        let in_world = bridged(&hands, image, config.max_gap_n)?;
        let object_from_world = match (config.reach, observation.world_from_object) {
            (ReachRule::Released, Some(world_from_object)) => world_from_object.inverse(),
            _ => object_from_world,
        };
        steps.push(Step {
            image: u32::try_from(image).unwrap_or(u32::MAX),
            time_s: step as f64 / recording.rate_hz(),
            cameras_n: observation.cameras_n,
            bridged: observation.keypoints_in_world.is_none(),
            keypoints_m: in_world.map(|point| (object_from_world * point).into()),
        });
    }
    Ok(Demonstration {
        sequence: sequence.to_owned(),
        object: recording.object.clone(),
        subject: recording.subject.clone(),
        hand: recording.hand,
        mirrored: false,
        start_reason: match first {
            0 => "the hand is in sight from the first image on".to_owned(),
            first => format!("image {first} is the first that shows the hand"),
        },
        end_reason: format!(
            "in image {} the object is {:.1} mm and {:.1} degrees from its rest",
            departure.left,
            1000.0 * departure.left_m,
            departure.left_rad.to_degrees(),
        ),
        rest,
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

/// Returns the hand in an image, interpolated between its neighbors in time where it is not seen.
fn bridged(
    hands: &[Option<Keypoints>],
    image: usize,
    max_gap_n: usize,
) -> Result<Keypoints, RecordingError> {
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
        return Err(RecordingError::Gap {
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
    use schemas::demonstrations::Side;

    use super::*;
    use crate::{
        fixture,
        ingest::Agreement,
        recording::{Observation, TableSource, Tag},
        table_pose,
    };

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
                    cameras_n: 1,
                    world_from_object: Some(Pose::new(pose)),
                }
            })
            .collect();
        Recording {
            object: "025_mug".to_owned(),
            subject: "a".to_owned(),
            hand: Side::Right,
            ground: TableSource::Tag(world_from_tag()),
            images,
            rate_hz: None,
            agreement: Agreement::default(),
        }
    }

    fn world_from_tag() -> Pose<World, Tag> {
        Pose::new(Isometry3::translation(0.0, 0.0, 0.9))
    }

    fn reach_with(recording: &Recording, rule: ReachRule) -> Result<Demonstration, RecordingError> {
        let config = IngestConfig {
            reach: rule,
            ..fixture::config()
        };
        let departure = departure(recording, &config)?;
        let rest = table_pose::on_tag(&world_from_tag(), &departure.world_from_object);
        reach("a-b", recording, &departure, rest, &config)
    }

    fn reach_of(recording: &Recording) -> Result<Demonstration, RecordingError> {
        reach_with(recording, ReachRule::Robust)
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
        assert_eq!(
            reach.start_reason,
            "image 2 is the first that shows the hand"
        );
        assert_eq!(
            reach.end_reason,
            "in image 20 the object is 20.0 mm and 0.0 degrees from its rest"
        );
    }

    #[test]
    fn the_released_rule_takes_each_step_to_its_own_image_of_the_object() {
        let mut recording = recording();
        let drift = Isometry3::translation(0.002, 0.0, 0.0);
        for image in &mut recording.images[10..] {
            let pose = image.world_from_object.unwrap();
            image.world_from_object = Some(Pose::new(drift * *pose));
        }
        let reach = reach_with(&recording, ReachRule::Released).unwrap();
        assert_eq!(reach.steps.len(), 18);
        assert!((reach.steps[7].keypoints_m[0][0] - (0.09 - 0.5)).abs() < 1e-12);
        assert!((reach.steps[17].keypoints_m[0][0] - (0.19 - 0.502)).abs() < 1e-12);
        // The robust rule has one frame for all: the rest in the middle.
        let reach = reach_of(&recording).unwrap();
        let moved = reach.steps[16].keypoints_m[0][0] - reach.steps[7].keypoints_m[0][0];
        assert!((moved - 0.09).abs() < 1e-12);
    }

    #[test]
    fn short_gaps_are_bridged_and_long_ones_refused() {
        let mut recording = recording();
        for image in 10..13 {
            recording.images[image].keypoints_in_world = None;
        }
        let reach = reach_of(&recording).unwrap();
        for (step, image) in reach.steps.iter().zip(2..) {
            assert_eq!(step.bridged, (10..13).contains(&image));
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
    fn names_the_missing_part_of_a_recording() {
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
