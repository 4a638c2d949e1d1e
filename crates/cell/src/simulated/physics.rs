//! One goal carried out in physics.

use robot::RobotModel;
use schemas::{executions::Outcome, rollouts::Verdict};
use simulation::{
    Flow, Motion, ObjectShape, Offset, SimulationError, Template, TraceStep, WatchedRollout,
};
use spatial::{Pose, Rest};

use super::{ObjectError, SimulatedCellConfig, Watched, journal::Job};
use crate::{
    goal::Goal,
    report::{Report, Sample},
};

/// How long a hand is watched that holds after its motion was broken off, in seconds.
const HOLD_S: f64 = 0.5;

/// Lays the object down as the goal says, but for the cell's error, and moves.
pub(super) fn carry_out(
    job: &Job,
    object: &ObjectShape,
    model: &RobotModel,
    config: &SimulatedCellConfig,
    watched: &mut Watched,
) -> Result<Report, SimulationError> {
    let goal = &job.goal;
    let mut scene = config.scene.clone();
    scene.object_offset = misplaced(scene.object_offset, config.object_error, &job.sealed.digest);
    let template = Template::new(&scene, model, object, &Rest::of(&goal.table_from_object))?;
    let mut reason = None;
    let mut see = |step: &TraceStep| {
        let asked = watched.see(&sample(step));
        if reason.is_none() && asked.is_some() {
            reason = asked;
            watched.halted();
        }
        match reason {
            None => Flow::GoOn,
            Some(_) => Flow::Hold,
        }
    };
    let motion = motion(goal, model);
    let WatchedRollout {
        rollout,
        broken_off,
    } = template.watched_rollout(&motion, &goal.grasp, HOLD_S, &mut see)?;
    let broken_off = reason.filter(|_| broken_off);
    let samples = rollout
        .trace
        .map_or_else(Vec::new, |trace| trace.steps.iter().map(sample).collect());
    Ok(Report {
        goal_id: job.sealed.goal_id.clone(),
        rejection: None,
        outcome: match broken_off {
            None => outcome(rollout.verdict),
            Some(_) => Outcome::Aborted,
        },
        message: broken_off.unwrap_or_else(|| rollout.verdict.as_str().to_owned()),
        lift_m: rollout.lift_m,
        joints: model.joint_names(),
        samples,
    })
}

/// Returns the motion in the order of the robot's own joints.
fn motion(goal: &Goal, model: &RobotModel) -> Motion {
    let columns: Vec<usize> = model
        .joints()
        .iter()
        .filter_map(|joint| goal.joints.iter().position(|name| *name == joint.name))
        .collect();
    let in_order = |q: &[f64]| {
        columns
            .iter()
            .filter_map(|&idx| q.get(idx).copied())
            .collect()
    };
    Motion {
        time_s: goal.steps.iter().map(|step| step.time_s).collect(),
        object_from_palm: goal
            .steps
            .iter()
            .map(|step| *step.object_from_palm.isometry())
            .collect(),
        q: goal
            .steps
            .iter()
            .map(|step| in_order(&step.q_rad))
            .collect(),
        rates: None,
    }
}

/// Adds this goal's own error to where the object lies.
fn misplaced(offset: Offset, bounds: ObjectError, digest: &str) -> Offset {
    let mut numbers = [0_u8; 24];
    blake3::Hasher::new_derive_key("pipeline 2026 where the object really lies")
        .update(digest.as_bytes())
        .finalize_xof()
        .fill(&mut numbers);
    let mut shares = numbers.as_chunks().0.iter().map(|&eight| {
        // 53 bits make every double in 0..1 on the grid of 2^-53; then −1..1.
        let share = (u64::from_le_bytes(eight) >> 11) as f64 / (1_u64 << 53) as f64;
        2.0 * share - 1.0
    });
    let mut next = |bound: f64| bound * shares.next().unwrap_or(0.0);
    Offset {
        x_m: offset.x_m + next(bounds.position_m),
        y_m: offset.y_m + next(bounds.position_m),
        yaw_rad: offset.yaw_rad + next(bounds.yaw_rad),
    }
}

fn sample(step: &TraceStep) -> Sample {
    Sample {
        time_s: step.time_s,
        table_from_palm: Pose::new(step.table_from_palm),
        table_from_object: Pose::new(step.table_from_object),
        q_rad: step.q.clone(),
        q_command_rad: step.q_command.clone(),
    }
}

/// Returns how a cell calls what physics found.
fn outcome(verdict: Verdict) -> Outcome {
    match verdict {
        Verdict::Held => Outcome::Succeeded,
        Verdict::KnockedOver | Verdict::NotGrasped | Verdict::Slipped | Verdict::Dropped => {
            Outcome::Failed
        }
        Verdict::Limit | Verdict::Table | Verdict::EarlyContact | Verdict::Diverged => {
            Outcome::Aborted
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_goal_has_its_own_error_within_the_bounds() {
        let bounds = ObjectError {
            position_m: 0.01,
            yaw_rad: 0.1,
        };
        let errors: Vec<Offset> = (0..1000)
            .map(|goal| misplaced(Offset::default(), bounds, &format!("{goal}")))
            .collect();
        assert!(
            errors
                .iter()
                .all(|e| e.x_m.abs() <= 0.01 && e.yaw_rad.abs() <= 0.1)
        );
        let mean = errors.iter().map(|e| e.y_m).sum::<f64>() / 1000.0;
        assert!(mean.abs() < 1e-3, "{mean}");
        assert_eq!(errors[0], misplaced(Offset::default(), bounds, "0"));
        assert_ne!(errors[0], errors[1]);
        let none = misplaced(Offset::default(), ObjectError::default(), "0");
        assert!(none.x_m == 0.0 && none.y_m == 0.0 && none.yaw_rad == 0.0);
    }
}
