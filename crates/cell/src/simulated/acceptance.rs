//! What a cell checks before it takes a goal.

use robot::{JointKind, RobotModel};

use crate::goal::{Goal, Rejection, RejectionCode};

/// Longest goal accepted, in bytes: an hour at 100 Hz would be twice that.
pub(super) const MAX_GOAL_BYTES: usize = 32 * 1024 * 1024;
/// Fewest steps of a motion.
const MIN_STEPS: usize = 2;

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
    model: &RobotModel,
    robot: &str,
    object_is_here: impl Fn(&str) -> bool,
) -> Result<(), Rejection> {
    if goal.robot != robot {
        return refuse(
            RejectionCode::Robot,
            format!("the goal is for robot {}, this one is {robot}", goal.robot),
        );
    }
    check_joints(goal, model)?;
    check_times(goal)?;
    check_limits(goal, model)?;
    if object_is_here(&goal.object) {
        Ok(())
    } else {
        refuse(
            RejectionCode::Object,
            format!("no object `{}` lies before the robot", goal.object),
        )
    }
}

fn check_joints(goal: &Goal, model: &RobotModel) -> Result<(), Rejection> {
    let unknown = goal.joints.iter().find(|name| model.joint(name).is_none());
    if let Some(name) = unknown {
        return refuse(
            RejectionCode::Joints,
            format!("the robot has no joint `{name}`"),
        );
    }
    let missing = model
        .joints()
        .iter()
        .find(|joint| !goal.joints.contains(&joint.name));
    if let Some(joint) = missing {
        return refuse(
            RejectionCode::Joints,
            format!("joint `{}` is missing", joint.name),
        );
    }
    if goal.joints.len() == model.dof() {
        Ok(())
    } else {
        refuse(RejectionCode::Joints, "a joint is named twice".to_owned())
    }
}

fn check_times(goal: &Goal) -> Result<(), Rejection> {
    if goal.steps.len() < MIN_STEPS {
        return refuse(
            RejectionCode::Times,
            format!("{} steps, expected at least {MIN_STEPS}", goal.steps.len()),
        );
    }
    let mut last_s = f64::NEG_INFINITY;
    for (idx, step) in goal.steps.iter().enumerate() {
        if step.time_s <= last_s {
            return refuse(
                RejectionCode::Times,
                format!("step {idx} is at {} s, not after {last_s} s", step.time_s),
            );
        }
        last_s = step.time_s;
    }
    Ok(())
}

fn check_limits(goal: &Goal, model: &RobotModel) -> Result<(), Rejection> {
    let tolerance = goal.grasp.limit_tolerance_rad;
    for (idx, step) in goal.steps.iter().enumerate() {
        for (name, &q) in goal.joints.iter().zip(&step.q_rad) {
            let Some(joint) = model
                .joint(name)
                .and_then(|joint| model.joints().get(joint))
            else {
                continue;
            };
            let inside = q >= joint.lower - tolerance && q <= joint.upper + tolerance;
            if joint.kind != JointKind::Continuous && !inside {
                return refuse(
                    RejectionCode::Limits,
                    format!(
                        "step {idx} has joint `{name}` at {q}, outside {} to {}",
                        joint.lower, joint.upper
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
