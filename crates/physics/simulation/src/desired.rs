//! Desired motion of fingers and palm between control steps, for drives that know more than a position.

use motion::{JointRates, Motion, Rates, joints_between};
use spatial::Object;

use crate::{
    config::{Approach, ControllerKind, Protocol, SceneConfig},
    played::CommandStep,
    script::Command,
};

/// Desired state of each joint at one time: position, velocity and acceleration, in rad, rad/s and
/// rad/s² (m, m/s and m/s² if prismatic).
#[derive(Debug, Clone, PartialEq)]
struct Knot {
    q: Vec<f64>,
    rates: JointRates,
}

/// A course of coordinates over a rollout, as a controller follows it: through one knot per control step, the start
/// first. Between two knots it is held at the second, or goes by the quintic polynomial that matches the positions,
/// velocities and accelerations of both.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Desired {
    knots: Vec<Knot>,
    control_s: f64,
    controller: ControllerKind,
}

/// Desired motion of the joints over one physics step.
///
/// The engine moves with the velocity at a step's end, so its velocities belong to the middles of
/// the steps and its accelerations to their beginnings. Sampled this way, the desired motion is
/// reached up to terms of second order in the step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DesiredStep {
    /// Positions at the end of the step.
    pub(crate) q: Vec<f64>,
    /// Velocities in the middle of the step.
    pub(crate) velocity: Vec<f64>,
    /// Accelerations at the beginning of the step, for a controller that knows the inertia.
    pub(crate) acceleration: Option<Vec<f64>>,
}

impl Desired {
    /// Takes the course of a script's commands.
    ///
    /// While the fingers follow a motion that knows its rates, they are the motion's own. Everywhere
    /// else, in the script's ramps and for a motion without rates, they are differences: velocity and
    /// acceleration of the parabola through a command and its two neighbors, 0 at the ends.
    pub(crate) fn new<R: Rates>(
        start: &Command,
        commands: &[Command],
        motion: &Motion<Object, R>,
        protocol: &Protocol,
        scene: &SceneConfig,
    ) -> Self {
        let control_s = scene.control_step_s();
        let all = std::iter::once(start).chain(commands);
        let all: Vec<&[f64]> = all.map(|command| &command.hand.q_rad[..]).collect();
        let reach_n = commands
            .iter()
            .filter(|command| command.phase.is_reach())
            .count();
        let follows = protocol.approach == Approach::Follow;
        let knot = |idx: usize| {
            let own = (follows && idx < reach_n)
                .then(|| followed(motion, idx as f64 / reach_n as f64, reach_n, control_s));
            own.flatten()
                .unwrap_or_else(|| Knot::of_course(&all, idx, control_s))
        };
        Self {
            knots: (0..all.len()).map(knot).collect(),
            control_s,
            controller: scene.drive.controller,
        }
    }

    /// Takes a course of which only the positions are known, one for each control step.
    pub(crate) fn of_course(course: &[&[f64]], scene: &SceneConfig) -> Self {
        let control_s = scene.control_step_s();
        let knots = (0..course.len()).map(|idx| Knot::of_course(course, idx, control_s));
        Self {
            knots: knots.collect(),
            control_s,
            controller: scene.drive.controller,
        }
    }

    /// Takes the course of a motion that is played, through its own rates.
    pub(crate) fn played(steps: &[CommandStep], scene: &SceneConfig) -> Self {
        let knot = |step: &CommandStep| Knot {
            q: step.q.clone(),
            rates: step.rates.clone(),
        };
        Self {
            knots: steps.iter().map(knot).collect(),
            control_s: scene.control_step_s(),
            controller: scene.drive.controller,
        }
    }

    /// Returns the joints at rest at the start, where commands have not yet arrived.
    pub(crate) fn before(&self) -> Option<DesiredStep> {
        let q = self.knots.first()?.q.clone();
        let velocity = vec![0.0; q.len()];
        Some(self.step(q, velocity.clone(), velocity))
    }

    /// Returns the desired motion over a physics step that begins `time_s` after the beginning of a control
    /// step (counted from 0) and lasts `step_s`; `None` beyond the end.
    pub(crate) fn during(
        &self,
        control_step: usize,
        time_s: f64,
        step_s: f64,
    ) -> Option<DesiredStep> {
        let (from, to) = (
            self.knots.get(control_step)?,
            self.knots.get(control_step + 1)?,
        );
        let held = |velocity: Vec<f64>| DesiredStep {
            q: to.q.clone(),
            velocity,
            acceleration: None,
        };
        match self.controller {
            ControllerKind::Pd => return Some(held(vec![0.0; to.q.len()])),
            ControllerKind::PdVelocity => return Some(held(to.rates.velocity.clone())),
            ControllerKind::PdVelocityInterpolated | ControllerKind::PdFeedforward => {}
        }
        let (from, to) = ((&from.q[..], &from.rates), (&to.q[..], &to.rates));
        let at = |time_s: f64| joints_between(from, to, self.control_s, time_s);
        Some(self.step(
            at(time_s + step_s).0,
            at(time_s + step_s / 2.0).1.velocity,
            at(time_s).1.acceleration,
        ))
    }

    fn step(&self, q: Vec<f64>, velocity: Vec<f64>, acceleration: Vec<f64>) -> DesiredStep {
        let knows_inertia = self.controller == ControllerKind::PdFeedforward;
        DesiredStep {
            q,
            velocity,
            acceleration: knows_inertia.then_some(acceleration),
        }
    }
}

impl Knot {
    /// Takes the position of one control step of a course, and its rates from its neighbors: those of the parabola
    /// through them; 0 where it lacks one.
    fn of_course(course: &[&[f64]], idx: usize, control_s: f64) -> Self {
        Self {
            q: course.get(idx).map(|q| q.to_vec()).unwrap_or_default(),
            rates: differences(course, idx, control_s),
        }
    }
}

/// Returns a motion's joints after a fraction of its duration, when it is stretched to `reach_n`
/// control steps; `None` if it does not know its rates.
fn followed<R: Rates>(
    motion: &Motion<Object, R>,
    fraction: f64,
    reach_n: usize,
    control_s: f64,
) -> Option<Knot> {
    let duration_s = motion.duration_s();
    let (q, mut rates) = motion.joints_at(motion.first().time_s + duration_s * fraction)?;
    // Seconds of the motion per second of the rollout.
    let speed = duration_s / (reach_n as f64 * control_s);
    for velocity in &mut rates.velocity {
        *velocity *= speed;
    }
    for acceleration in &mut rates.acceleration {
        *acceleration *= speed * speed;
    }
    Some(Knot { q, rates })
}

fn differences(course: &[&[f64]], idx: usize, control_s: f64) -> JointRates {
    let q = |idx: usize| course.get(idx).copied();
    let (Some(before), Some(now), Some(after)) =
        (idx.checked_sub(1).and_then(q), q(idx), q(idx + 1))
    else {
        let dof = q(idx).map_or(0, <[f64]>::len);
        return JointRates::zero(dof);
    };
    let neighbors = || before.iter().zip(now).zip(after);
    JointRates {
        velocity: neighbors()
            .map(|((before, _), after)| (after - before) / (2.0 * control_s))
            .collect(),
        acceleration: neighbors()
            .map(|((before, now), after)| (after - 2.0 * now + before) / control_s.powi(2))
            .collect(),
    }
}
