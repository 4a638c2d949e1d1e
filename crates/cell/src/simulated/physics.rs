//! One goal carried out in physics.

use motion::JointTrack;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use robot::JointOrder;
use schemas::{executions::Outcome, rollouts::Verdict};
use simulation::{Flow, ObjectShape, SimulationError, Template, TraceStep, WatchedRollout};
use spatial::{Pose, Rest};

use super::{BrokenOff, Robot, SimulatedCellConfig, gap::EncoderNoise, journal::Job, playing};
use crate::report::{Report, Sample};

/// How long a hand is watched that holds after its motion was broken off, in seconds.
const HOLD_S: f64 = 0.5;
/// Time between two samples of a report, in seconds, where the control step is not longer.
const SAMPLE_S: f64 = 0.01;

/// Lays the object down as the goal says, but for the cell's error, and moves; `see` is shown every
/// control step, and says why the motion is to be broken off, if it is.
pub(super) fn carry_out(
    job: &Job,
    object: &ObjectShape,
    robot: &Robot,
    config: &SimulatedCellConfig,
    see: &mut dyn FnMut(&Sample) -> Option<BrokenOff>,
) -> Result<Report, SimulationError> {
    let goal = &job.goal;
    let digest = &job.sealed.digest;
    let mut scene = config.scene.clone();
    scene.object_offset = config.gap.object.misplaced(scene.object_offset, digest);
    let rest = Rest::of(&goal.table_from_object);
    let template = Template::new(&scene, &robot.hand, object, &rest)?;
    let believed = *template.table_from_believed().isometry();
    let table_from_scene = level(goal.table_from_object.isometry(), &believed);
    // What comes to rest otherwise than it was laid down, as a ball does, takes no palm with it.
    let object_from_table = (table_from_scene * believed).inverse();
    let mut steps = playing::steps(
        goal,
        robot,
        &object_from_table,
        scene.control_step_s(),
        config.gap.latency_s,
    )?;
    let mut encoders = Encoders::new(
        EncoderNoise::of(digest, config.gap.encoder_noise_rad),
        steps.len(),
        robot.hand.dof(),
        playing::arm_of(goal, robot)?,
        config.gap.latency_s,
        table_from_scene,
    );
    for (step, noise) in steps.iter_mut().zip(&encoders.noise) {
        // A drive that takes a joint to be further than it is drives it less far.
        for (q, noise) in step.q.iter_mut().zip(noise) {
            *q -= noise;
        }
    }
    let (mut samples, mut reason): (Vec<Sample>, Option<BrokenOff>) = (Vec::new(), None);
    let mut shown = |step: &TraceStep| {
        let sample = encoders.read(step);
        let asked = see(&sample);
        let now_s = sample.time_s;
        let due = SAMPLE_S * (samples.len() as f64 - 1e-9);
        if sample.time_s >= due {
            samples.push(sample);
        }
        reason = reason.take().or(asked);
        if reason.is_some() {
            encoders.halt(now_s);
        }
        match reason {
            None => Flow::GoOn,
            Some(_) => Flow::Hold,
        }
    };
    let WatchedRollout {
        rollout,
        broken_off,
    } = template.play(&steps, &goal.grasp, HOLD_S, &mut shown)?;
    let broken_off = reason.filter(|_| broken_off);
    let samples = match rollout.verdict {
        Verdict::Diverged => Vec::new(),
        _ => samples,
    };
    let lift_m = match (broken_off.is_some(), samples.first(), samples.last()) {
        (false, Some(_), _) => rollout.lift_m,
        // The physics looked at it when it was broken off, and it was held for a while then.
        (true, Some(first), Some(last)) => height_m(last) - height_m(first),
        _ => 0.0,
    };
    let end = broken_off.unwrap_or_else(|| BrokenOff {
        outcome: outcome(rollout.verdict),
        message: rollout.verdict.as_str().to_owned(),
    });
    let joints = goal.joint_names();
    let order = JointOrder::new(&robot.joint_names(), &joints);
    let order = order.map_err(|err| SimulationError::Motion(err.to_string()))?;
    let samples = samples.into_iter().map(|sample| sample.in_order(&order));
    let samples = samples.collect::<Result<_, _>>();
    Ok(Report {
        goal_id: job.sealed.goal_id.clone(),
        rejection: None,
        outcome: end.outcome,
        message: end.message,
        lift_m,
        samples: samples.map_err(|err| SimulationError::Motion(err.to_string()))?,
        joints,
    })
}

fn height_m(sample: &Sample) -> f64 {
    sample.table_from_object.isometry().translation.z
}

/// What the joints' encoders show.
struct Encoders {
    /// What is added at each step of the motion; what comes after it has the last step's.
    noise: Vec<Vec<f64>>,
    seen_n: usize,
    /// What the arm is told, which it does exactly but late.
    arm: Option<JointTrack>,
    latency_s: f64,
    /// When the arm was told to stand still.
    halted_s: Option<f64>,
    /// The scene has the object where the simulation puts it, turned as it likes.
    table_from_scene: Isometry3<f64>,
}

impl Encoders {
    fn new(
        mut drawn: EncoderNoise,
        steps_n: usize,
        dof: usize,
        arm: Option<JointTrack>,
        latency_s: f64,
        table_from_scene: Isometry3<f64>,
    ) -> Self {
        Self {
            arm,
            latency_s,
            halted_s: None,
            table_from_scene,
            noise: (0..steps_n).map(|_| drawn.step(dof)).collect(),
            seen_n: 0,
        }
    }

    /// From this time on the arm stands still.
    fn halt(&mut self, time_s: f64) {
        self.halted_s.get_or_insert(time_s);
    }

    /// Returns what is measured at the next step, and what was commanded but for the noise.
    fn read(&mut self, step: &TraceStep) -> Sample {
        // A goal has one step at least: its start.
        let noise = &self.noise[self.seen_n.min(self.noise.len() - 1)];
        self.seen_n += 1;
        let add = |q: &[f64]| -> Vec<f64> {
            let joints = q.iter().enumerate();
            joints.map(|(joint, q)| q + noise[joint]).collect()
        };
        let (mut q_rad, mut q_command_rad) = (add(&step.q), add(&step.q_command));
        // It is where it is told to be, as late as the fingers are told.
        let told_s = self.halted_s.unwrap_or(step.time_s) - self.latency_s;
        if let Some(arm) = self.arm.as_ref().and_then(|arm| arm.at(told_s)) {
            q_rad.extend(&arm.q_rad);
            q_command_rad.extend(&arm.q_rad);
        }
        Sample {
            time_s: step.time_s,
            table_from_palm: Pose::new(self.table_from_scene * step.table_from_palm),
            table_from_object: Pose::new(self.table_from_scene * step.table_from_object),
            q_rad,
            q_command_rad,
        }
    }
}

/// Returns the turn about the vertical and the shift along the table that take an object from where a
/// scene has it to where it stands.
fn level(table_from_object: &Isometry3<f64>, scene_from_object: &Isometry3<f64>) -> Isometry3<f64> {
    let turn = table_from_object.rotation * scene_from_object.rotation.inverse();
    // Of the quaternion, what is about z.
    let yaw = 2.0 * turn.coords.z.atan2(turn.coords.w);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let mut shift =
        table_from_object.translation.vector - turn * scene_from_object.translation.vector;
    shift.z = 0.0;
    Isometry3::from_parts(Translation3::from(shift), turn)
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
