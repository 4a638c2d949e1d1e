//! What a cell checks before it takes a goal.

use robot::{Joint, JointKind};
use simulation::{Protocol, Trial};

use super::Robot;
use crate::{
    goal::{Goal, Rejection, RejectionCode},
    track::{Carrier, Timed, Track},
};

/// Longest goal accepted, in bytes: a minute of 16 joints at 333 Hz.
pub(super) const MAX_GOAL_BYTES: usize = 8 * 1024 * 1024;
/// Fewest points of a controller.
const MIN_POINTS: usize = 2;
/// How far beyond the URDF's limits a finger may be told to be, whatever the goal says, in radians (meters
/// if prismatic): it presses on its stop then.
const MOST_TOLERANCE_RAD: f64 = 0.1;
/// Time between two looks at a motion, in seconds, at most.
const LOOK_S: f64 = 0.002;
/// Longest motion, in seconds.
const MOST_S: f64 = 600.0;
/// Relative excess of a speed that may lie between two looks of a dispatcher at it.
const ROUNDING: f64 = 1e-4;

/// Checks a message's length, before anything of it is read.
pub(super) fn check_length(bytes: &[u8]) -> Result<(), Rejection> {
    if bytes.len() <= MAX_GOAL_BYTES {
        return Ok(());
    }
    refuse(
        RejectionCode::TooLarge,
        format!("{} bytes, expected at most {MAX_GOAL_BYTES}", bytes.len()),
    )
}

/// Checks that the robot can carry out a goal: its joints, their limits, times and the object.
pub(super) fn check(
    goal: &Goal,
    robot: &Robot,
    object_is_here: impl Fn(&str) -> bool,
) -> Result<(), Rejection> {
    if goal.robot != robot.digest {
        let expected = &robot.digest;
        return refuse(
            RejectionCode::Robot,
            format!(
                "the goal is for robot {}, this one is {expected}",
                goal.robot
            ),
        );
    }
    if goal.grasp.trial != Trial::Lift {
        return refuse(
            RejectionCode::Malformed,
            "a cell lifts what it grasps, and pulls at nothing".to_owned(),
        );
    }
    check_phases(&goal.grasp)?;
    let tolerance = goal
        .grasp
        .limit_tolerance_rad
        .clamp(0.0, MOST_TOLERANCE_RAD);
    check_track(&goal.hand, "hand", robot.hand.joints(), tolerance)?;
    match (&goal.carrier, &robot.arm) {
        (Carrier::Palm(points), None) => check_times("palm", points)?,
        (Carrier::Arm(track), Some(arm)) => check_track(track, "arm", &arm.joints, 0.0)?,
        (Carrier::Palm(_), Some(_)) => {
            let problem = "the goal has a palm fly that this cell has on an arm".to_owned();
            return refuse(RejectionCode::Joints, problem);
        }
        (Carrier::Arm(_), None) => {
            return refuse(RejectionCode::Joints, "this cell has no arm".to_owned());
        }
    }
    if object_is_here(&goal.object) {
        Ok(())
    } else {
        refuse(
            RejectionCode::Object,
            format!("no object `{}` lies before the robot", goal.object),
        )
    }
}

/// Checks what a controller with these joints is told.
fn check_track(
    track: &Track,
    controller: &str,
    joints: &[Joint],
    tolerance: f64,
) -> Result<(), Rejection> {
    let wrong = |problem: String| refuse(RejectionCode::Joints, problem);
    let known = |name: &String| joints.iter().find(|joint| joint.name == *name);
    if let Some(name) = track.joints.iter().find(|&name| known(name).is_none()) {
        return wrong(format!("the {controller} has no joint `{name}`"));
    }
    let missing = joints
        .iter()
        .find(|joint| !track.joints.contains(&joint.name));
    if let Some(joint) = missing {
        return wrong(format!("joint `{}` is missing", joint.name));
    }
    if track.joints.len() != joints.len() {
        return wrong("a joint is named twice".to_owned());
    }
    check_times(controller, &track.points)?;
    let ordered: Vec<&Joint> = track.joints.iter().filter_map(known).collect();
    check_limits(track, &ordered, tolerance)
}

/// Checks how long the parts of a motion last.
fn check_phases(grasp: &Protocol) -> Result<(), Rejection> {
    let parts = [
        ("reach_s", grasp.reach_s),
        ("squeeze_s", grasp.squeeze_s),
        ("pause_s", grasp.pause_s),
        ("lift_s", grasp.lift_s),
        ("hold_s", grasp.hold_s),
    ];
    for (name, part_s) in parts {
        if !(part_s.is_finite() && (0.0..=MOST_S).contains(&part_s)) {
            let problem = format!("`{name}` is {part_s} s, expected 0 to {MOST_S}");
            return refuse(RejectionCode::Times, problem);
        }
    }
    let all_s: f64 = parts.iter().map(|(_, part_s)| part_s).sum();
    if all_s > MOST_S {
        let problem = format!("the motion lasts {all_s} s, expected up to {MOST_S}");
        return refuse(RejectionCode::Times, problem);
    }
    Ok(())
}

fn check_times<T: Timed>(controller: &str, points: &[T]) -> Result<(), Rejection> {
    let wrong = |problem: String| refuse(RejectionCode::Times, problem);
    if points.len() < MIN_POINTS {
        return wrong(format!(
            "{} points of the {controller}, expected at least {MIN_POINTS}",
            points.len()
        ));
    }
    if let Some(first) = points.first().filter(|first| first.time_s() != 0.0) {
        return wrong(format!(
            "the {controller}'s first point is at {} s, not at 0",
            first.time_s()
        ));
    }
    let mut last_s = f64::NEG_INFINITY;
    for (idx, point) in points.iter().enumerate() {
        let time_s = point.time_s();
        if time_s <= last_s || time_s > MOST_S {
            return wrong(format!(
                "point {idx} of the {controller} is at {time_s} s, expected after {last_s} and up to {MOST_S}"
            ));
        }
        last_s = time_s;
    }
    Ok(())
}

/// Checks positions and velocities: at the points, halfway between them, and every two milliseconds.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count of looks between 2 and 300,000"
)]
fn check_limits(track: &Track, joints: &[&Joint], tolerance: f64) -> Result<(), Rejection> {
    let between = track.points.windows(2).flat_map(|pair| {
        let ends = pair.first().zip(pair.last());
        let (from_s, to_s) = ends.map_or((0.0, 0.0), |(from, to)| (from.time_s, to.time_s));
        // Times are those of a motion that is not too long.
        let looks = ((to_s - from_s) / LOOK_S)
            .ceil()
            .clamp(2.0, MOST_S / LOOK_S);
        (0..looks as u32).map(move |look| from_s + (to_s - from_s) * f64::from(look) / looks)
    });
    let end = track.points.last().map(|point| point.time_s);
    for point in between.chain(end).filter_map(|time_s| track.at(time_s)) {
        let time_s = point.time_s;
        let moving = point.q_rad.iter().zip(&point.velocity_rad_per_s);
        for (joint, (&q, &velocity)) in joints.iter().zip(moving) {
            let Joint {
                name, lower, upper, ..
            } = joint;
            let is_inside = q >= lower - tolerance && q <= upper + tolerance;
            if joint.kind != JointKind::Continuous && !is_inside {
                return refuse(
                    RejectionCode::Limits,
                    format!(
                        "joint `{name}` would be at {q} after {time_s} s, outside {lower} to {upper}"
                    ),
                );
            }
            let most = joint.velocity;
            if most > 0.0 && velocity.abs() > most * (1.0 + ROUNDING) {
                return refuse(
                    RejectionCode::Limits,
                    format!(
                        "joint `{name}` would move at {velocity} per second after {time_s} s, faster than {most}"
                    ),
                );
            }
        }
    }
    Ok(())
}

fn refuse(code: RejectionCode, reason: String) -> Result<(), Rejection> {
    Err(Rejection::new(code, reason))
}
