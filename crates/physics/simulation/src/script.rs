//! Commands to palm and fingers, one per control step.

use motion::{HandState, Motion, Rates};
use nalgebra::Vector3;
use options::OptionFault;
use robot::RobotModel;
use spatial::{Object, Palm, Pose, Table};

use crate::{
    config::{Approach, Protocol, SceneConfig, Trial},
    desired::Desired,
    error::SimulationError,
};

/// The ways in which an object is pulled.
const DIRECTIONS: [[f64; 3]; 6] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
];

/// A part of a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// The palm moves and the hand must not touch hard.
    Reach,
    /// The fingers close; still part of the reach.
    Close,
    /// The fingers press.
    Squeeze,
    /// The palm rises.
    Lift,
    /// The palm holds the object, or shakes it.
    Hold,
    /// The object is pulled; nothing else moves.
    Pull,
}

impl Phase {
    /// Whether it is part of the reach.
    pub(crate) fn is_reach(self) -> bool {
        matches!(self, Self::Reach | Self::Close)
    }
}

/// Command at the end of one control step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Command {
    /// The part of the rollout.
    pub(crate) phase: Phase,
    /// Commanded pose of the hand before it is carried.
    pub(crate) hand: HandState<Object>,
    /// Displacement by which it is carried from there, along the table's axes, in meters.
    pub(crate) carried_in_table_m: Vector3<f64>,
    /// Acceleration with which the object is pulled, in the table's frame, in meters per second
    /// squared.
    pub(crate) pull_in_table_m_per_s2: Vector3<f64>,
}

/// Setpoint of palm and fingers at the end of one control step, for an execution elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct Setpoint {
    /// The part of the rollout.
    pub phase: Phase,
    /// Commanded pose of the palm.
    pub table_from_palm: Pose<Table, Palm>,
    /// Commanded joint positions in radians.
    pub q: Vec<f64>,
}

impl Command {
    /// Returns the commanded pose of the palm, given the estimated pose of the object.
    pub(crate) fn table_from_palm(
        &self,
        table_from_estimate: &Pose<Table, Object>,
    ) -> Pose<Table, Palm> {
        (*table_from_estimate * self.hand.frame_from_palm).translated(&self.carried_in_table_m)
    }

    /// Returns the command in the table's frame.
    pub(crate) fn setpoint(&self, table_from_estimate: &Pose<Table, Object>) -> Setpoint {
        Setpoint {
            phase: self.phase,
            table_from_palm: self.table_from_palm(table_from_estimate),
            q: self.hand.q_rad.clone(),
        }
    }
}

/// All commands of a rollout, the starting pose first.
pub(crate) struct Script {
    /// Command of the starting pose.
    pub(crate) start: Command,
    /// One command per control step.
    pub(crate) commands: Vec<Command>,
    /// The motion itself over the control steps of the reach, its first step included.
    pub(crate) requested: Vec<HandState<Object>>,
    /// The fingers' course between the commands, if their drives look ahead.
    pub(crate) desired: Option<Desired>,
}

impl Script {
    /// Writes the script of a motion.
    pub(crate) fn new<R: Rates>(
        motion: &Motion<Object, R>,
        protocol: &Protocol,
        scene: &SceneConfig,
        model: &RobotModel,
    ) -> Result<Self, SimulationError> {
        check(motion, protocol, model)?;
        let writer = Writer {
            motion,
            protocol,
            flexion: Flexion::new(protocol, model)?,
        };
        let reach = steps(protocol.reach_s, scene).max(1);
        let squeeze = steps(protocol.squeeze_s, scene);
        let pause = steps(protocol.pause_s, scene);
        let start = writer.reach(0.0);
        let follows = protocol.approach != Approach::AtGrasp;
        let mut requested = vec![writer.at(if follows { 0.0 } else { 1.0 })];
        let mut commands = Vec::with_capacity(reach + squeeze + pause);
        for fraction in fractions(reach) {
            commands.push(writer.reach(fraction));
            if follows {
                requested.push(writer.at(fraction));
            }
        }
        for fraction in fractions(squeeze) {
            commands.push(writer.grasp(Phase::Squeeze, fraction));
        }
        for _ in 0..pause {
            commands.push(writer.grasp(Phase::Squeeze, 1.0));
        }
        commands.extend(match protocol.trial {
            Trial::Lift => writer.lift(scene),
            Trial::SixDirections => writer.pulls(scene),
        });
        let follows_motion = scene.drive.controller.follows_motion();
        let desired =
            follows_motion.then(|| Desired::new(&start, &commands, motion, protocol, scene));
        Ok(Self {
            start,
            commands,
            requested,
            desired,
        })
    }

    /// Returns the number of control steps of the reach.
    pub(crate) fn reach_len(&self) -> usize {
        let reach = self.commands.iter().filter(|c| c.phase.is_reach());
        reach.count()
    }

    /// Returns the first of the commands from which on the palm stays where it is, but for being carried.
    pub(crate) fn arrival(&self) -> usize {
        let Some(last) = self.commands.last() else {
            return 0;
        };
        let is_there =
            |command: &Command| command.hand.frame_from_palm == last.hand.frame_from_palm;
        let before = [&self.start].into_iter().chain(&self.commands);
        before
            .enumerate()
            .filter(|(_, command)| !is_there(command))
            .last()
            .map_or(0, |(idx, _)| idx + 1)
    }
}

/// Returns the number of control steps in a duration.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to a small positive range first"
)]
pub(crate) fn steps(seconds: f64, scene: &SceneConfig) -> usize {
    (seconds / scene.control_step_s()).round().clamp(0.0, 1e6) as usize
}

/// Returns the ends of `n` equal steps as fractions of their sum.
fn fractions(n: usize) -> impl Iterator<Item = f64> {
    (1..=n).map(move |step| step as f64 / n as f64)
}

/// Fails if a motion is not one of this hand, or its protocol stands for settings that were not taken.
fn check<R: Rates>(
    motion: &Motion<Object, R>,
    protocol: &Protocol,
    model: &RobotModel,
) -> Result<(), SimulationError> {
    if motion.joints()[..] != model.joint_names()[..] {
        let message = format!(
            "its joints are {:?}, those of the hand {:?}",
            motion.joints(),
            model.joint_names()
        );
        return Err(SimulationError::Motion(message));
    }
    if !protocol.is_resolved() {
        let problem = "stands for settings that were not taken: call `Protocol::resolved`";
        return Err(OptionFault::new("name", problem).into());
    }
    Ok(())
}

/// Joints that flex together when the hand opens and squeezes.
#[derive(Debug, Clone, PartialEq)]
pub struct Flexion {
    /// 1 for each joint that flexes, 0 for the others, with its limits.
    joints: Vec<(f64, [f64; 2])>,
}

impl Flexion {
    /// Takes the joints that a protocol names.
    ///
    /// # Errors
    ///
    /// Fails if the hand lacks one of them.
    pub fn new(protocol: &Protocol, hand: &RobotModel) -> Result<Self, SimulationError> {
        let limits = hand.joints().iter().map(|joint| [joint.lower, joint.upper]);
        let mut joints: Vec<(f64, [f64; 2])> = limits.map(|limits| (0.0, limits)).collect();
        for name in &protocol.flexion_joints {
            match hand.joint(name).and_then(|joint| joints.get_mut(joint)) {
                Some((weight, _)) => *weight = 1.0,
                None => {
                    return Err(SimulationError::UnknownJoint {
                        name: name.clone(),
                        known: hand.joint_names(),
                    });
                }
            }
        }
        Ok(Self { joints })
    }

    /// Moves the joints that flex by a share of the distance to their upper limits, or, if it is negative, to
    /// their lower ones; a joint without limits stays.
    fn towards_limit(&self, q: &[f64], share: f64) -> Vec<f64> {
        let joints = q.iter().zip(&self.joints);
        let moved = joints.map(|(&position, (weight, [lower, upper]))| {
            let limit = if share < 0.0 { lower } else { upper };
            if limit.is_finite() {
                position + weight * share.abs() * (limit - position)
            } else {
                position
            }
        });
        moved.collect()
    }

    /// Adds `angle` in radians to the joints that flex; never beyond a limit that `q` itself keeps.
    pub fn flexed(&self, q: &[f64], angle: f64) -> Vec<f64> {
        q.iter()
            .zip(&self.joints)
            .map(|(&position, (weight, [lower, upper]))| {
                (position + weight * angle)
                    .max(lower.min(position))
                    .min(upper.max(position))
            })
            .collect()
    }
}

struct Writer<'a, R> {
    motion: &'a Motion<Object, R>,
    protocol: &'a Protocol,
    flexion: Flexion,
}

impl<R: Rates> Writer<'_, R> {
    /// Returns the commands of the lift, of the shakes that follow it, if any, and of the hold.
    fn lift(&self, scene: &SceneConfig) -> Vec<Command> {
        let protocol = self.protocol;
        let published = protocol.published();
        let mut commands = Vec::new();
        let lifted = |share: f64| Vector3::z() * share * protocol.lift_m;
        for fraction in fractions(steps(protocol.lift_s, scene).max(1)) {
            let smooth = fraction * fraction * (3.0 - 2.0 * fraction);
            let even = published.constant_speed_lift;
            let share = if even { fraction } else { smooth };
            commands.push(self.carried(Phase::Lift, lifted(share)));
        }
        if let Some(shakes) = published.shakes {
            let shake = steps(shakes.period_s, scene).max(1);
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                for fraction in fractions(shake) {
                    let shaken = axis * shakes.at(fraction);
                    commands.push(self.carried(Phase::Hold, lifted(1.0) + shaken));
                }
            }
        }
        for _ in 0..steps(protocol.hold_s, scene).max(1) {
            commands.push(self.carried(Phase::Hold, lifted(1.0)));
        }
        commands
    }

    /// Returns the commands of the pulls, one direction after another.
    fn pulls(&self, scene: &SceneConfig) -> Vec<Command> {
        let pull = &self.protocol.pull;
        let n_steps = steps(pull.pull_s, scene).max(1);
        let directions = DIRECTIONS.into_iter();
        let pulls = directions.flat_map(|direction| std::iter::repeat_n(direction, n_steps));
        pulls
            .map(|direction| Command {
                pull_in_table_m_per_s2: Vector3::from(direction) * pull.force_n_per_kg,
                ..self.grasp(Phase::Pull, 1.0)
            })
            .collect()
    }

    /// Returns the command after a fraction of the reach.
    fn reach(&self, fraction: f64) -> Command {
        let closing = match self.protocol.approach {
            Approach::Follow | Approach::Open => self.protocol.close_fraction.clamp(0.0, 1.0),
            Approach::AtGrasp => 1.0,
        };
        let before = 1.0 - closing;
        let phase = if fraction <= before {
            Phase::Reach
        } else {
            Phase::Close
        };
        let hand = match self.protocol.approach {
            Approach::Follow => self.at(fraction),
            Approach::Open => {
                let path = self.at(if before > 0.0 { fraction / before } else { 1.0 });
                let closed = if phase == Phase::Close {
                    (fraction - before) / closing
                } else {
                    0.0
                };
                HandState {
                    q_rad: self.flexion.flexed(
                        &self.at(1.0).q_rad,
                        -self.protocol.open_rad * (1.0 - closed),
                    ),
                    ..path
                }
            }
            Approach::AtGrasp => {
                let grasp = self.at(1.0);
                let opened = self
                    .flexion
                    .towards_limit(&grasp.q_rad, -self.protocol.published().open_share);
                let opened = self.flexion.flexed(&opened, -self.protocol.open_rad);
                let between = opened.iter().zip(&grasp.q_rad);
                HandState {
                    q_rad: between
                        .map(|(open, closed)| open + fraction * (closed - open))
                        .collect(),
                    ..grasp
                }
            }
        };
        Command {
            phase,
            hand,
            carried_in_table_m: Vector3::zeros(),
            pull_in_table_m_per_s2: Vector3::zeros(),
        }
    }

    /// Returns the command at the grasp, squeezed by a fraction.
    fn grasp(&self, phase: Phase, squeeze: f64) -> Command {
        let grasp = self.at(1.0);
        let share = self.protocol.published().squeeze_share * squeeze;
        let closed = self.flexion.towards_limit(&grasp.q_rad, share);
        Command {
            phase,
            hand: HandState {
                q_rad: self
                    .flexion
                    .flexed(&closed, self.protocol.squeeze_rad * squeeze),
                ..grasp
            },
            carried_in_table_m: Vector3::zeros(),
            pull_in_table_m_per_s2: Vector3::zeros(),
        }
    }

    /// Returns the command of the squeezed grasp carried to a place.
    fn carried(&self, phase: Phase, carried_in_table_m: Vector3<f64>) -> Command {
        Command {
            carried_in_table_m,
            ..self.grasp(phase, 1.0)
        }
    }

    fn at(&self, fraction: f64) -> HandState<Object> {
        self.motion.at_fraction(fraction).into()
    }
}
