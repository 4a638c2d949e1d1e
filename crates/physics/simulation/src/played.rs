//! Precomputed motions, to the end of their hold, that are played step by step.

use motion::{HandState, JointRates};
use nalgebra::Vector3;
use robot::RobotModel;
use spatial::{Object, Palm, Pose};

use crate::{
    config::SceneConfig,
    desired::Desired,
    error::SimulationError,
    script::{Command, Phase, Script},
};

/// Setpoint of palm and fingers at the end of one control step; the first is their start.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandStep {
    /// The part of the rollout.
    pub phase: Phase,
    /// Pose of the palm in the frame of the object as it lay, before it is lifted.
    pub object_from_palm: Pose<Object, Palm>,
    /// Lift of the palm above that pose, along the table's z, in meters.
    pub lift_m: f64,
    /// Joint positions in radians, in the order of the hand's joints.
    pub q: Vec<f64>,
    /// Their velocities and accelerations.
    pub rates: JointRates,
}

impl Script {
    /// Makes the script of a precomputed motion without changes: one step per control step, its start before them.
    ///
    /// Geometry alone refuses by the grasp, the last step of the reach: before it the fingers may be
    /// opened further than in the requested motion.
    pub(crate) fn played(
        steps: &[CommandStep],
        scene: &SceneConfig,
        model: &RobotModel,
    ) -> Result<Self, SimulationError> {
        check(steps, model.dof())?;
        let commands = steps.iter().map(|step| Command {
            phase: step.phase,
            hand: HandState {
                frame_from_palm: step.object_from_palm,
                q_rad: step.q.clone(),
            },
            carried_in_table_m: Vector3::z() * step.lift_m,
            pull_in_table_m_per_s2: Vector3::zeros(),
        });
        let mut commands: Vec<Command> = commands.collect();
        let reach = commands.iter().rfind(|command| command.phase.is_reach());
        let requested = reach.map(|grasp| grasp.hand.clone()).into_iter().collect();
        let start = commands.remove(0);
        let follows_motion = scene.drive.controller.follows_motion();
        let desired = follows_motion.then(|| Desired::played(steps, scene));
        Ok(Self {
            start,
            commands,
            requested,
            desired,
        })
    }
}

/// Checks that the steps can be played by a hand with `dof` joints.
fn check(steps: &[CommandStep], dof: usize) -> Result<(), SimulationError> {
    let fail = |message: String| Err(SimulationError::Motion(message));
    let has = |phase: Phase| steps.iter().skip(1).any(|step| step.phase == phase);
    if !(has(Phase::Lift) && has(Phase::Hold)) || steps.len() < 2 {
        return fail("it is not lifted and held".to_owned());
    }
    if steps.windows(2).any(|pair| pair[1].phase < pair[0].phase) {
        return fail("its phases are not in their order".to_owned());
    }
    for (idx, step) in steps.iter().enumerate() {
        let numbers = [&step.q, &step.rates.velocity, &step.rates.acceleration];
        if let Some(wrong) = numbers.iter().find(|numbers| numbers.len() != dof) {
            return fail(format!(
                "step {idx} has {} numbers for {dof} joints",
                wrong.len()
            ));
        }
        let pose = &step.object_from_palm;
        let is_finite = numbers
            .into_iter()
            .flatten()
            .chain(&pose.translation.vector)
            .chain(&pose.rotation.coords)
            .chain([&step.lift_m])
            .all(|number| number.is_finite());
        if !is_finite {
            return fail(format!("step {idx} has a number that is not finite"));
        }
    }
    Ok(())
}
