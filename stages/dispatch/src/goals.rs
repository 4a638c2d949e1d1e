//! Motions as goals.

use cell::{Goal, Grasp};
use planning::{PlannedMotion, Planner};
use schemas::candidates::{Candidate, Candidates};

use crate::{DispatchConfig, names::JointNames, refusal::Refusal, robots::Robots};

/// Returns a feasible motion as a goal for a robot.
pub(crate) fn goal(
    config: &DispatchConfig,
    robots: &Robots,
    planner: &Planner<'_>,
    names: &JointNames,
    candidates: &Candidates,
    candidate: &Candidate,
) -> Result<Goal, Refusal> {
    let PlannedMotion {
        table_from_object,
        carrier,
        fingers,
        grasp,
    } = planner.plan(&candidate.motion, &candidate.table_from_object)?;
    let grasp = Grasp::try_from(&grasp).map_err(Refusal::Protocol)?;
    let mut goal = Goal {
        candidate_id: candidate.candidate_id.clone(),
        object: candidates.object.clone(),
        robot: robots.digest(),
        attempt: config.attempt,
        resumed: 0,
        table_from_object,
        start_tolerance_rad: config.start_tolerance_rad,
        grasp,
        carrier,
        hand: fingers,
    };
    names.to_wire(&mut goal);
    Ok(goal)
}
