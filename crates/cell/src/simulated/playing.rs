//! A goal's commands to palm and fingers at each control step.

use motion::{JointTrack, PalmPoint, PalmTrajectory};
use simulation::{CommandStep, Phase, SimulationError};
use spatial::{Object, Palm, Pose, Table};

use crate::{CellRobot, Goal, Grasp};

/// Rounding of a phase's duration, as a fraction of a control step.
const ROUNDING: f64 = 1e-6;

/// Largest deviation of a lift from the vertical above the grasp, in meters and radians.
const ASIDE_M: f64 = 1e-3;
const ASIDE_RAD: f64 = 0.01;

/// Returns the goal's steps, its start first, each delayed by `latency_s`, for an object at
/// `object_from_table`.
pub(super) fn steps(
    goal: &Goal,
    robot: &CellRobot,
    object_from_table: &Pose<Object, Table>,
    control_s: f64,
    latency_s: f64,
) -> Result<Vec<CommandStep>, SimulationError> {
    let broken = |message: &str| SimulationError::Motion(message.to_owned());
    let hand = in_order(&goal.hand, &robot.hand.joint_names())?;
    let arm = arm_of(goal, robot)?;
    let phases = Phases::new(&goal.grasp, control_s);
    let palm = |time_s: f64| {
        let table_from_palm = match &goal.carrier {
            PalmTrajectory::Palm(points) => PalmPoint::between(points, time_s),
            PalmTrajectory::Arm(_) => arm
                .as_ref()
                .and_then(|arm| robot.palm(&arm.at(time_s)?.q_rad)),
        };
        table_from_palm
            .ok_or_else(|| broken("the palm's or arm's controller commands no pose of the palm"))
    };
    let grasp = palm(phases.grasp_s)?;
    let steps = (phases.end_s + latency_s) / control_s;
    (0..=whole(steps))
        .map(|step| {
            let time_s = (step as f64 * control_s - latency_s).max(0.0);
            let phase = phases.at(time_s);
            // After the grasp the palm only rises.
            let now = palm(time_s)?;
            let (table_from_palm, lift_m) = if time_s < phases.arrival_s {
                (now, 0.0)
            } else {
                let off = grasp.inv_mul(&now);
                let aside = (now.translation.vector - grasp.translation.vector)
                    .xy()
                    .norm();
                if aside > ASIDE_M || off.rotation.angle() > ASIDE_RAD {
                    return Err(broken(
                        "this cell only rises straight from the grasp, and the goal does not",
                    ));
                }
                (grasp, rise(&grasp, &now))
            };
            let joints = hand
                .at(time_s)
                .ok_or_else(|| broken("the hand has no commands"))?;
            Ok(CommandStep {
                phase,
                object_from_palm: *object_from_table * table_from_palm,
                lift_m,
                q: joints.q_rad,
                rates: joints.rates,
            })
        })
        .collect()
}

/// Returns the height of a palm above the grasp, in meters.
fn rise(grasp: &Pose<Table, Palm>, now: &Pose<Table, Palm>) -> f64 {
    now.translation.z - grasp.translation.z
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cell takes no goal that is longer than minutes"
)]
fn whole(steps: f64) -> usize {
    (steps - ROUNDING).ceil().clamp(1.0, 1e6) as usize
}

/// End times of the motion's phases, in seconds.
#[expect(clippy::struct_field_names, reason = "a unit ends every name")]
struct Phases {
    reach_s: f64,
    /// Arrival of the palm at the grasp.
    arrival_s: f64,
    grasp_s: f64,
    squeezed_s: f64,
    lifted_s: f64,
    end_s: f64,
}

impl Phases {
    /// As in a script, lift and hold take a control step at least.
    fn new(grasp: &Grasp, control_s: f64) -> Self {
        let closing_s = grasp.reach_s * grasp.close_fraction.clamp(0.0, 1.0);
        let grasp_s = grasp.reach_s;
        let squeezed_s = grasp_s + grasp.squeeze_s + grasp.pause_s;
        let lifted_s = squeezed_s + grasp.lift_s.max(control_s);
        Self {
            reach_s: grasp_s - closing_s,
            arrival_s: grasp.path_s(),
            grasp_s,
            squeezed_s,
            lifted_s,
            end_s: lifted_s + grasp.hold_s.max(control_s),
        }
    }

    /// Returns the phase that a control step ends in.
    fn at(&self, time_s: f64) -> Phase {
        let until = |end_s: f64| time_s <= end_s * (1.0 + ROUNDING);
        if until(self.reach_s) {
            Phase::Reach
        } else if until(self.grasp_s) {
            Phase::Close
        } else if until(self.squeezed_s) {
            Phase::Squeeze
        } else if until(self.lifted_s) {
            Phase::Lift
        } else {
            Phase::Hold
        }
    }
}

/// Returns the arm's track, if there is one, with its joints in its own order.
pub(super) fn arm_of(
    goal: &Goal,
    robot: &CellRobot,
) -> Result<Option<JointTrack>, SimulationError> {
    match (&goal.carrier, &robot.arm) {
        (PalmTrajectory::Arm(track), Some(arm)) => in_order(track, &arm.joint_names()).map(Some),
        (PalmTrajectory::Arm(_), None) | (PalmTrajectory::Palm(_), _) => Ok(None),
    }
}

/// Returns a track with its joints in the given order.
fn in_order(track: &JointTrack, joints: &[String]) -> Result<JointTrack, SimulationError> {
    let ordered = track.reordered(joints);
    ordered.map_err(|err| SimulationError::Motion(err.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A published protocol judges at the end of the lift; a script lifts and holds for a step all the same.
    #[test]
    fn lift_and_hold_take_a_step_at_least() {
        let given = serde_json::from_str(include_str!("../../examples/grasp.json"));
        let grasp = Grasp {
            lift_s: 0.0,
            hold_s: 0.0,
            ..given.unwrap()
        };
        let control_s = 0.02;
        let phases = Phases::new(&grasp, control_s);
        let steps = whole(phases.end_s / control_s);
        let played: Vec<Phase> = (0..=steps)
            .map(|step| phases.at(step as f64 * control_s))
            .collect();
        assert!(
            played.contains(&Phase::Lift) && played.contains(&Phase::Hold),
            "{played:?}"
        );
    }
}
