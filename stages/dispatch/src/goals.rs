//! The motions to send, as goals.

use cell::{Goal, GoalStep, robot_digest};
use schemas::{
    candidates::{Candidate, Candidates},
    rollouts::{Rollout, Verdict},
};

use crate::{DispatchConfig, DispatchError};

/// Returns the accepted motions in the order of their rollouts, at most `per_object`.
pub(crate) fn accepted<'a>(
    rollouts: &[Rollout],
    candidates: &'a Candidates,
    per_object: usize,
) -> Result<Vec<&'a Candidate>, DispatchError> {
    rollouts
        .iter()
        .filter(|rollout| rollout.verdict == Verdict::Held)
        .take(per_object)
        .map(|rollout| {
            candidates
                .candidates
                .iter()
                .find(|candidate| candidate.candidate_id == rollout.candidate_id)
                .ok_or_else(|| DispatchError::NoCandidate {
                    object: candidates.object.clone(),
                    candidate_id: rollout.candidate_id.clone(),
                })
        })
        .collect()
}

/// Returns a motion as a goal for the robot described by `urdf`.
pub(crate) fn goal(
    config: &DispatchConfig,
    urdf: &str,
    candidates: &Candidates,
    candidate: &Candidate,
) -> Goal {
    Goal {
        candidate_id: candidate.candidate_id.clone(),
        object: candidates.object.clone(),
        robot: robot_digest(urdf),
        attempt: config.attempt,
        table_from_object: candidate.table_from_object,
        joints: candidates.joints.clone(),
        start_tolerance_rad: config.start_tolerance_rad,
        grasp: config.grasp.clone(),
        steps: candidate
            .steps
            .iter()
            .map(|step| GoalStep {
                time_s: step.time_s,
                object_from_palm: step.object_from_palm,
                q_rad: step.q_rad.clone(),
            })
            .collect(),
    }
}
