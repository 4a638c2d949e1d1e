//! A `LeRobot` dataset of version 3.0, without images: one Parquet file of frames, one of episodes, one of
//! tasks, and what they mean as JSON.
//!
//! The layout is that of `lerobot` 0.6, <https://github.com/huggingface/lerobot>, `src/lerobot/datasets`.

mod about;
mod stats;
mod tables;

use std::collections::BTreeMap;

use crate::{
    Episode, EpisodeStep, Export, FormatError,
    episode::{check_together, joint_names, pose_names, without_commands},
    lerobot::stats::Stats,
};

/// Parts of an interval by which a motion may exceed its last frame, so that rounding adds no frame.
const INTERVAL_ROUNDING: f64 = 1e-6;

const STATE: &str = "observation.state";
const ENVIRONMENT: &str = "observation.environment_state";
const ACTION: &str = "action";

/// A frame of an episode.
struct Frame {
    /// Palm pose in the table's frame and joint positions.
    state: Vec<f32>,
    /// Pose of the object in the table's frame.
    environment: Vec<f32>,
    /// The next frame's palm pose, and the joint positions commanded.
    action: Vec<f32>,
}

/// An episode at a uniform rate.
struct Recorded<'a> {
    episode: &'a Episode,
    task: usize,
    frames: Vec<Frame>,
}

/// A feature of the dataset: its name, the names of its numbers, and their accessor.
type Feature = (&'static str, Vec<String>, fn(&Frame) -> &[f32]);

/// Writes motions as a dataset with `fps` frames a second, interpolated linearly; the last frame is at or
/// after the motion's end, and has its last step. `robot_type` names the hand.
///
/// # Errors
///
/// Fails without motions, or if they are not of one hand or share a name.
pub fn to_lerobot(episodes: &[Episode], fps: u32, robot_type: &str) -> Result<Export, FormatError> {
    let first = check_together(episodes)?;
    let names = [pose_names("palm").to_vec(), joint_names(first.joints())].concat();
    let features: [Feature; 3] = [
        (STATE, names.clone(), |frame| &frame.state),
        (ENVIRONMENT, pose_names("object").to_vec(), |frame| {
            &frame.environment
        }),
        (ACTION, names, |frame| &frame.action),
    ];
    let mut tasks: BTreeMap<String, usize> = BTreeMap::new();
    let steps = episodes.iter().map(|episode| resampled(episode, fps));
    let steps: Vec<Vec<EpisodeStep>> = steps.collect();
    let recorded: Vec<Recorded<'_>> = episodes
        .iter()
        .zip(&steps)
        .map(|(episode, steps)| {
            let next = tasks.len();
            Recorded {
                episode,
                task: *tasks.entry(task(episode.object())).or_insert(next),
                frames: frames(steps),
            }
        })
        .collect();
    let lost = lost(episodes, &steps, fps)?;
    let mut export = Export::default();
    export.put(
        "meta/info.json",
        about::info(&recorded, &features, tasks.len(), fps, robot_type),
    );
    export.put(
        "meta/stats.json",
        about::stats(&Stats::of(&recorded, &features, fps)),
    );
    export.put("meta/tasks.parquet", tables::tasks(&tasks)?);
    export.put(
        "meta/episodes/chunk-000/file-000.parquet",
        tables::episodes(&recorded, &features, fps)?,
    );
    export.put(
        "data/chunk-000/file-000.parquet",
        tables::frames(&recorded, &features, fps)?,
    );
    export.put(
        "README.md",
        about::readme(&recorded, fps, robot_type, &lost),
    );
    export.lost = lost;
    Ok(export)
}

/// The task of every motion for an object.
fn task(object: &str) -> String {
    format!("grasp {object}")
}

/// Returns the frames of steps.
fn frames(steps: &[EpisodeStep]) -> Vec<Frame> {
    let palms = continuous(steps.iter().map(|step| step.table_from_palm.to_array()));
    let objects = continuous(steps.iter().map(|step| step.table_from_object.to_array()));
    let hand = |palm: &[f64; 7], q: &[f64]| singles(palm.iter().chain(q).copied());
    (0..steps.len())
        .map(|idx| {
            let next = (idx + 1).min(steps.len() - 1);
            let command = steps[idx].q_command.as_ref();
            Frame {
                state: hand(&palms[idx], &steps[idx].q),
                environment: singles(objects[idx]),
                action: hand(&palms[next], command.unwrap_or(&steps[next].q)),
            }
        })
        .collect()
}

/// Returns poses with the signs of their quaternions such that none jumps: a learner sees numbers, not rotations.
fn continuous(poses: impl Iterator<Item = [f64; 7]>) -> Vec<[f64; 7]> {
    let mut smooth: Vec<[f64; 7]> = Vec::new();
    for mut pose in poses {
        let dot = smooth.last().map_or(1.0, |last| {
            let both = last[3..].iter().zip(&pose[3..]);
            both.map(|(a, b)| a * b).sum()
        });
        if dot < 0.0 {
            pose[3..].iter_mut().for_each(|number| *number = -*number);
        }
        smooth.push(pose);
    }
    smooth
}

/// The steps at the frames' times.
fn resampled(episode: &Episode, fps: u32) -> Vec<EpisodeStep> {
    let fps = f64::from(fps);
    let intervals = (episode.duration_s() * fps - INTERVAL_ROUNDING)
        .ceil()
        .max(0.0);
    let mut steps = Vec::new();
    let mut frame = 0.0;
    while frame <= intervals {
        steps.push(episode.at(frame / fps));
        frame += 1.0;
    }
    steps
}

/// Converts numbers to the precision of the format.
#[expect(clippy::cast_possible_truncation, reason = "the format has 32 bits")]
fn singles(numbers: impl IntoIterator<Item = f64>) -> Vec<f32> {
    numbers.into_iter().map(|number| number as f32).collect()
}

/// Says what the dataset does not hold.
fn lost(
    episodes: &[Episode],
    resampled: &[Vec<EpisodeStep>],
    fps: u32,
) -> Result<Vec<String>, FormatError> {
    let (palm_m, joint) = resampling_error(episodes, resampled)?;
    let mut lost = vec![
        format!(
            "motion between frames: linear between frames at {fps} Hz, the palm is within {palm_m:.1e} m and \
             each joint within {joint:.1e} rad (m if prismatic) of the motion"
        ),
        "digits beyond those of 32-bit numbers".to_owned(),
        "velocities, accelerations, contacts, forces, latent codes, metrics".to_owned(),
        "images: none are recorded".to_owned(),
        "shapes of hand and object: only their names and poses are in it".to_owned(),
        "units and frames have no field of the format: they are in `info`, end the names of the numbers, and README.md says them".to_owned(),
    ];
    let without = without_commands(episodes);
    lost.extend(
        without.map(|fact| format!("{fact}, and their actions are the next frame's positions")),
    );
    Ok(lost)
}

/// The farthest that palm (in meters) and joints are from their motions when frames are interpolated.
fn resampling_error(
    episodes: &[Episode],
    resampled: &[Vec<EpisodeStep>],
) -> Result<(f64, f64), FormatError> {
    let mut worst = (0.0_f64, 0.0_f64);
    for (episode, steps) in episodes.iter().zip(resampled) {
        let again = Episode::new(episode.name(), episode.object(), episode.joints(), steps)?;
        for was in episode.steps() {
            let is = again.at(was.time_s);
            let apart =
                was.table_from_palm.translation.vector - is.table_from_palm.translation.vector;
            worst.0 = worst.0.max(apart.norm());
            let joints = was.q.iter().zip(&is.q);
            worst.1 = joints.fold(worst.1, |worst, (was, is)| worst.max((was - is).abs()));
        }
    }
    Ok(worst)
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use spatial::Pose;

    use super::*;
    use crate::episode::tests::{episode, joints, step};

    #[test]
    fn frames_are_uniform_and_the_last_has_the_grasp() {
        let short = episode("a", &[0.0, 0.31, 1.02]);
        let frames = frames(&resampled(&short, 10));
        assert_eq!(frames.len(), 12);
        let last = step(1.02);
        let last = last.table_from_palm.to_array().into_iter().chain(last.q);
        assert_eq!(frames[11].state, singles(last));
        assert_eq!(frames[11].action, frames[11].state);
        assert_eq!(frames[4].action, frames[5].state);
    }

    #[test]
    fn duration_of_whole_intervals_has_no_extra_frame() {
        for fps in [1, 3, 7, 30, 60] {
            let times: Vec<f64> = (0..=2 * fps)
                .map(|k| f64::from(k) / f64::from(fps))
                .collect();
            assert_eq!(
                frames(&resampled(&episode("a", &times), fps)).len(),
                times.len(),
                "{fps} Hz"
            );
        }
        assert_eq!(frames(&resampled(&episode("a", &[3.0]), 30)).len(), 1);
    }

    #[test]
    fn actions_are_commands_where_there_are_any() {
        let steps = [0.0, 0.5, 1.0].map(|time_s| EpisodeStep {
            q_command: Some(vec![time_s + 1.0, 0.25]),
            ..step(time_s)
        });
        let commanded = Episode::new("a", "o", &joints(), &steps).unwrap();
        let steps = resampled(&commanded, 2);
        let frames = frames(&steps);
        assert_eq!(frames[1].action[7..], [1.5, 0.25]);
        assert_eq!(frames[1].action[..7], frames[2].state[..7]);
        let lost = lost(&[commanded], &[steps], 2).unwrap();
        assert!(!lost.iter().any(|fact| fact.starts_with("commands")));
    }

    #[test]
    fn quaternions_do_not_jump_when_a_hand_turns_all_the_way_round() {
        let steps = (0..=20).map(|k| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.4 * f64::from(k));
            EpisodeStep {
                table_from_palm: Pose::from_parts([0.0; 3], turn),
                ..step(0.1 * f64::from(k))
            }
        });
        let steps: Vec<EpisodeStep> = steps.collect();
        let turning = Episode::new("a", "o", &joints(), &steps).unwrap();
        let frames = frames(&resampled(&turning, 20));
        for pair in frames.windows(2) {
            let dot: f32 = (3..7).map(|k| pair[0].state[k] * pair[1].state[k]).sum();
            assert!(dot > 0.99, "{dot}");
            assert_eq!(pair[0].action[..7], pair[1].state[..7]);
        }
    }

    #[test]
    fn loss_by_resampling_is_measured() {
        let joint = |fps| {
            let corner = [0.0, 0.13, 0.26].map(|time_s: f64| EpisodeStep {
                q: vec![(time_s - 0.13).abs(), 0.0],
                ..step(0.0)
            });
            let steps = corner.into_iter().zip([0.0, 0.13, 0.26]);
            let steps = steps.map(|(step, time_s)| EpisodeStep { time_s, ..step });
            let corner = Episode::new("a", "o", &joints(), &steps.collect::<Vec<_>>()).unwrap();
            let steps = resampled(&corner, fps);
            resampling_error(&[corner], &[steps]).unwrap().1
        };
        // The corner at 0.13 s is cut by the line from 0.13 at 0 s to 0.07 at 0.2 s.
        assert!((joint(5) - 0.091).abs() < 1e-9, "{}", joint(5));
        assert!(joint(100) < 1e-12);
    }
}
