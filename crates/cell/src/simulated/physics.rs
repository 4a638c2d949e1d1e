//! Execution of one goal in physics.

use motion::JointTrack;
use nalgebra::{UnitQuaternion, Vector3};
use robot::{JointKind, JointOrder};
use schemas::{executions::Outcome, rollouts::Verdict};
use simulation::{
    CommandStep, ObjectShape, SettledScene, SimulationError, StepDecision, TraceStep,
    WatchedRollout,
};
use spatial::{Object, Pose, RestingPose, Table};

use super::{SimulatedCellConfig, model_mismatch::EncoderNoise, playing};
use crate::{
    CellRobot, EncodedGoal, Goal,
    report::{Report, Sample},
    server::Abort,
};

/// Time for which a hand is simulated after its motion was aborted, in seconds.
const HOLD_S: f64 = 0.5;
/// Excess over a joint's limits at which the motion is aborted, in radians and in meters: a report with
/// more than `contradiction::LIMIT_RAD` would not be believed.
const MAX_EXCESS_RAD: f64 = 0.15;
const MAX_EXCESS_M: f64 = 0.015;
/// Sampling period of a report, in seconds, unless the control step is longer.
const SAMPLE_S: f64 = 0.01;

/// Places the object as the goal says, plus the cell's pose error, and moves; `see` is called at
/// every control step and returns a reason to abort, if any.
pub(super) fn execute(
    (goal, encoded): (&Goal, &EncodedGoal),
    object: &ObjectShape,
    robot: &CellRobot,
    config: &SimulatedCellConfig,
    see: &mut dyn FnMut(&Sample) -> Option<Abort>,
) -> Result<Report, SimulationError> {
    let digest = &encoded.digest;
    let scene = config.mismatch.drawn(&config.scene, digest);
    let rest = RestingPose::of(&goal.table_from_object);
    let settled = SettledScene::new(&scene, &robot.hand, object, &rest)?;
    let scene_from_estimate = settled.table_from_estimate().reinterpret();
    let table_from_scene = level(&goal.table_from_object, &scene_from_estimate);
    // An object that settles into another pose, as a ball does, does not carry the palm along.
    let object_from_table = (table_from_scene * scene_from_estimate).inverse();
    let mut steps = playing::steps(
        goal,
        robot,
        &object_from_table,
        scene.control_step_s(),
        config.mismatch.latency_s,
    )?;
    let delay_n = scene.delay_control_steps();
    let mut encoders = Encoders::new(
        EncoderNoise::of(digest, config.mismatch.encoder_noise_rad),
        [steps.len(), delay_n],
        robot.hand.dof(),
        playing::arm_of(goal, robot)?,
        config.mismatch.latency_s,
        table_from_scene,
    );
    encoders.mislead(&mut steps);
    let (mut samples, mut reason): (Vec<Sample>, Option<Abort>) = (Vec::new(), None);
    let mut shown = |step: &TraceStep| {
        let sample = encoders.read(step);
        let abort = see(&sample).or_else(|| beyond_limits(robot, &sample));
        let now_s = sample.time_s;
        let due = SAMPLE_S * (samples.len() as f64 - 1e-9);
        if sample.time_s >= due {
            samples.push(sample);
        }
        reason = reason.take().or(abort);
        if reason.is_some() {
            encoders.halt(now_s);
        }
        match reason {
            None => StepDecision::Continue,
            Some(_) => StepDecision::Hold,
        }
    };
    let WatchedRollout { rollout, aborted } =
        settled.execute(&steps, &goal.grasp.protocol(), HOLD_S, &mut shown)?;
    let aborted = reason.filter(|_| aborted);
    let samples = match rollout.verdict {
        Verdict::Diverged => Vec::new(),
        _ => samples,
    };
    let lift_m = match (aborted.is_some(), samples.first(), samples.last()) {
        (false, Some(_), _) => rollout.measures.lift_m,
        // The physics measured the object at the abort, and the hand held it for a while after.
        (true, Some(first), Some(last)) => height_m(last) - height_m(first),
        _ => 0.0,
    };
    let end = aborted.unwrap_or_else(|| Abort {
        outcome: outcome(rollout.verdict),
        message: rollout.verdict.as_str().to_owned(),
    });
    let joints = goal.joint_names();
    let samples = reordered(samples, robot, &joints)?;
    Ok(Report {
        goal_id: encoded.goal_id.clone(),
        rejection: None,
        outcome: end.outcome,
        message: end.message,
        lift_m,
        samples,
        joints,
    })
}

/// Returns samples of a robot with their joints in this order.
fn reordered(
    samples: Vec<Sample>,
    robot: &CellRobot,
    joints: &[String],
) -> Result<Vec<Sample>, SimulationError> {
    let order = JointOrder::new(&robot.joint_names(), joints);
    let order = order.map_err(|err| SimulationError::Motion(err.to_string()))?;
    let samples = samples.into_iter().map(|sample| sample.in_order(&order));
    let samples = samples.collect::<Result<_, _>>();
    samples.map_err(|err| SimulationError::Motion(err.to_string()))
}

/// Returns the reason to abort if a measured joint is far beyond its limits: contact pushes it into its stop.
fn beyond_limits(robot: &CellRobot, sample: &Sample) -> Option<Abort> {
    robot.joints().zip(&sample.q_rad).find_map(|(joint, &q)| {
        let (most, unit) = match joint.kind {
            JointKind::Prismatic => (MAX_EXCESS_M, "m"),
            _ => (MAX_EXCESS_RAD, "rad"),
        };
        let excess = (joint.lower - q).max(q - joint.upper);
        (excess > most).then(|| Abort {
            outcome: Outcome::Aborted,
            message: format!(
                "joint `{}` is {excess:.2} {unit} beyond its limits",
                joint.name
            ),
        })
    })
}

fn height_m(sample: &Sample) -> f64 {
    sample.table_from_object.translation.z
}

/// The table's frame in the simulation, which places the object at its origin, with its own yaw.
enum SceneFrame {}

/// Readings of the joints' encoders.
struct Encoders {
    /// Noise of each step of the motion; later steps reuse the last one's.
    noise: Vec<Vec<f64>>,
    /// Steps after which a command arrives at the drives, which then add their noise to it.
    delay_n: usize,
    seen_n: usize,
    /// Commands of the arm, which follows them exactly but late.
    arm: Option<JointTrack>,
    latency_s: f64,
    /// The time from which the robot holds still, and the index of the step whose command it holds.
    halt: Option<(f64, usize)>,
    table_from_scene: Pose<Table, SceneFrame>,
}

impl Encoders {
    fn new(
        mut drawn: EncoderNoise,
        [steps_n, delay_n]: [usize; 2],
        dof: usize,
        arm: Option<JointTrack>,
        latency_s: f64,
        table_from_scene: Pose<Table, SceneFrame>,
    ) -> Self {
        Self {
            arm,
            latency_s,
            halt: None,
            table_from_scene,
            noise: (0..steps_n + delay_n).map(|_| drawn.step(dof)).collect(),
            delay_n,
            seen_n: 0,
        }
    }

    /// Takes the noise at the time of its arrival from each command: a drive that reads a joint as too far
    /// along when a command arrives drives it less far.
    fn mislead(&self, steps: &mut [CommandStep]) {
        for (step, noise) in steps.iter_mut().zip(&self.noise[self.delay_n..]) {
            for (q, noise) in step.q.iter_mut().zip(noise) {
                *q -= noise;
            }
        }
    }

    /// Holds the last step's command from this time on.
    fn halt(&mut self, time_s: f64) {
        let last = self.seen_n.saturating_sub(1);
        self.halt.get_or_insert((time_s, last));
    }

    /// Returns the next step's measurement, and its command without the noise.
    fn read(&mut self, step: &TraceStep) -> Sample {
        let (command_s, command_n) = self.halt.unwrap_or((step.time_s, self.seen_n));
        let add = |q: &[f64], step_n: usize| -> Vec<f64> {
            // A goal has at least one step: its start.
            let noise = &self.noise[step_n.min(self.noise.len() - 1)];
            q.iter().zip(noise).map(|(q, noise)| q + noise).collect()
        };
        let mut q_rad = add(&step.q, self.seen_n);
        let mut q_command_rad = add(&step.q_command, command_n + self.delay_n);
        self.seen_n += 1;
        // The arm is where it is commanded to be, with the fingers' latency.
        let commanded_s = command_s - self.latency_s;
        if let Some(arm) = self.arm.as_ref().and_then(|arm| arm.at(commanded_s)) {
            q_rad.extend(&arm.q_rad);
            q_command_rad.extend(&arm.q_rad);
        }
        Sample {
            time_s: step.time_s,
            table_from_palm: self.table_from_scene * step.table_from_palm.reinterpret(),
            table_from_object: self.table_from_scene * step.table_from_object.reinterpret(),
            q_rad,
            q_command_rad,
        }
    }
}

/// Returns the yaw and the shift along the table that take an object from its pose in a scene to
/// its pose on the table.
fn level(
    table_from_object: &Pose<Table, Object>,
    scene_from_object: &Pose<SceneFrame, Object>,
) -> Pose<Table, SceneFrame> {
    let turn = table_from_object.rotation * scene_from_object.rotation.inverse();
    // The quaternion's twist about z.
    let yaw = 2.0 * turn.coords.z.atan2(turn.coords.w);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let mut shift =
        table_from_object.translation.vector - turn * scene_from_object.translation.vector;
    shift.z = 0.0;
    Pose::from_parts(shift, turn)
}

/// Returns a cell's outcome for a physics verdict.
fn outcome(verdict: Verdict) -> Outcome {
    match verdict {
        Verdict::Held => Outcome::Succeeded,
        Verdict::KnockedOver
        | Verdict::NotGrasped
        | Verdict::Slipped
        | Verdict::Dropped
        | Verdict::TooDeep
        | Verdict::Overloaded => Outcome::Failed,
        Verdict::Limit
        | Verdict::Table
        | Verdict::EarlyContact
        | Verdict::Diverged
        | Verdict::Infeasible => Outcome::Aborted,
    }
}

#[cfg(test)]
mod tests {
    use robot::RobotModel;

    use super::*;

    #[test]
    fn a_joint_that_is_pushed_far_into_its_stop_aborts_the_motion() {
        let urdf = include_str!("../../tests/gripper.urdf");
        let hand = RobotModel::from_urdf(urdf).unwrap();
        let robot = CellRobot::new(urdf, hand, None).unwrap();
        let at = |q: f64| {
            let sample = Sample {
                q_rad: vec![0.0, q],
                ..super::super::at_rest(&robot)
            };
            beyond_limits(&robot, &sample).map(|abort| abort.message)
        };
        // Its limits are 0 and 0.06 m.
        assert_eq!(
            (at(0.0), at(0.06), at(0.074), at(-0.014)),
            (None, None, None, None)
        );
        let said = Some("joint `slide_right` is 0.02 m beyond its limits".to_owned());
        assert_eq!((at(0.076), at(-0.016)), (said.clone(), said));
    }
}
