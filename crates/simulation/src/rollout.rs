//! One motion carried out in physics, and its verdict.

use nalgebra::{Isometry3, Point3};
use schemas::rollouts::Verdict;

use crate::{
    config::Protocol,
    contact::{Touch, touch},
    desired::Desired,
    precision::isometry,
    script::{Command, Phase, Script, steps},
    template::Template,
    world::{Finite, World},
};

/// Speed (m/s, rad/s) beyond which nothing moves in this scene unless the simulation failed.
const IMPLAUSIBLE_SPEED: f32 = 500.0;
/// Distance in meters from the table's origin beyond which the object is lost.
const IMPLAUSIBLE_DISTANCE_M: f64 = 10.0;
/// Time at the end of the hold over which slip and contact are judged, in seconds.
const FINAL_WINDOW_S: f64 = 0.5;
/// Share of the final window's steps in which a link must press to count as in contact.
const TOUCHING_SHARE: f64 = 0.5;

/// Whether the steps of a rollout are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record {
    /// Only the verdict and its figures.
    Nothing,
    /// Every control step too.
    Trace,
}

/// What became of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// How it ended; success is [`Verdict::Held`].
    pub verdict: Verdict,
    /// Control steps simulated.
    pub cost_n: u32,
    /// Rise of the object's origin at the end, in meters.
    pub lift_m: f64,
    /// Motion of the object in the palm frame between lift and end, in meters.
    pub slip_m: f64,
    /// Motion of the object on the table before the squeeze, in meters.
    pub displacement_m: f64,
    /// Deepest contact between hand and object while held, in meters.
    pub penetration_m: f64,
    /// Hand links in contact with the object at the end.
    pub contacts_n: u32,
    /// The steps, if they were asked for and anything was simulated.
    pub trace: Option<Trace>,
}

impl Rollout {
    /// Returns what became of a motion that geometry alone refuses.
    pub(crate) fn refused(verdict: Verdict) -> Self {
        Self {
            verdict,
            cost_n: 0,
            lift_m: 0.0,
            slip_m: 0.0,
            displacement_m: 0.0,
            penetration_m: 0.0,
            contacts_n: 0,
            trace: None,
        }
    }
}

/// The steps of a rollout; the first one is its start, at time 0.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// The steps in time order, one per control step.
    pub steps: Vec<TraceStep>,
}

/// One control step of a rollout.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceStep {
    /// Seconds since the start.
    pub time_s: f64,
    /// Pose of the palm in the table frame.
    pub table_from_palm: Isometry3<f64>,
    /// Joint positions in radians.
    pub q: Vec<f64>,
    /// Commanded joint positions in radians.
    pub q_command: Vec<f64>,
    /// Pose of the object in the table frame.
    pub table_from_object: Isometry3<f64>,
}

/// Carries out a script in a copy of the template's world.
pub(crate) fn run(
    template: &Template,
    script: &Script,
    protocol: &Protocol,
    record: Record,
) -> Rollout {
    let mut world = template.world.fork();
    let believed = *template.table_from_believed().isometry();
    template.hand.place(
        &mut world,
        &script.start.table_from_palm(&believed),
        &script.start.hand.q,
    );
    let mut judge = Judge::new(template, protocol, script);
    let mut trace = (record == Record::Trace).then(Trace::default);
    let mut verdict = None;
    let control_s = template.scene.control_step_s();
    if let Some(trace) = &mut trace {
        trace
            .steps
            .push(look(template, &world, 0.0, &script.start.hand.q));
    }
    let mut cost_n: u32 = 0;
    for (idx, command) in script.commands.iter().enumerate() {
        template
            .hand
            .move_palm(&mut world, &command.table_from_palm(&believed), control_s);
        let finite = match &script.desired {
            None => control_step(template, &mut world, &command.hand.q),
            Some(desired) => control_step_along(template, &mut world, desired, idx),
        };
        cost_n += 1;
        if let Some(trace) = &mut trace {
            let time_s = f64::from(cost_n) * control_s;
            trace
                .steps
                .push(look(template, &world, time_s, &command.hand.q));
        }
        verdict = match finite {
            Finite::No => Some(Verdict::Diverged),
            Finite::Yes => judge.see(template, &world, command),
        };
        if verdict.is_some() {
            break;
        }
    }
    let verdict = verdict.unwrap_or_else(|| judge.conclude());
    Rollout {
        verdict,
        cost_n,
        lift_m: sane(judge.rise_m),
        slip_m: sane(judge.slip_m()),
        displacement_m: sane(judge.displacement_m),
        penetration_m: sane(judge.penetration_m),
        contacts_n: judge.contacts_n(),
        trace: trace.filter(|_| verdict != Verdict::Diverged),
    }
}

/// Returns a figure as it can be stored: 0 for what has no meaning after a divergence.
fn sane(figure: f64) -> f64 {
    if figure.is_finite() { figure } else { 0.0 }
}

/// Advances by one control step with the fingers' command held.
fn control_step(template: &Template, world: &mut World, q_command: &[f64]) -> Finite {
    for _ in 0..template.scene.steps_per_control {
        template.hand.drive(world, q_command);
        if world.step() == Finite::No {
            return Finite::No;
        }
    }
    Finite::Yes
}

/// Advances by one control step with the fingers on their course.
fn control_step_along(
    template: &Template,
    world: &mut World,
    desired: &Desired,
    control_step: usize,
) -> Finite {
    let step_s = template.scene.time_step_s;
    for step in 0..template.scene.steps_per_control {
        let time_s = f64::from(step) * step_s;
        if let Some(asked) = desired.asked(control_step, time_s, step_s) {
            template.hand.follow(world, &asked);
        }
        if world.step() == Finite::No {
            return Finite::No;
        }
    }
    Finite::Yes
}

fn table_from_object(template: &Template, world: &World) -> Isometry3<f64> {
    world
        .bodies
        .get(template.object)
        .map_or_else(Isometry3::identity, |body| isometry(body.position()))
}

fn look(template: &Template, world: &World, time_s: f64, q_command: &[f64]) -> TraceStep {
    TraceStep {
        time_s,
        table_from_palm: template.hand.table_from_palm(world),
        q: template.hand.positions(world),
        q_command: q_command.to_vec(),
        table_from_object: table_from_object(template, world),
    }
}

/// Follows a rollout and ends it as soon as its verdict is known.
struct Judge<'a> {
    protocol: &'a Protocol,
    start: Isometry3<f64>,
    rise_m: f64,
    displacement_m: f64,
    penetration_m: f64,
    /// The object's origin in the palm frame, from the end of the lift on.
    in_palm: Vec<Point3<f64>>,
    /// The object's origin in the palm frame after the latest step.
    last_in_palm: Point3<f64>,
    lift_left: usize,
    hold_left: usize,
    window: usize,
    control_s: f64,
    /// Steps of the final window in which each body of the hand pressed.
    pressed: Vec<usize>,
}

impl<'a> Judge<'a> {
    fn new(template: &Template, protocol: &'a Protocol, script: &Script) -> Self {
        let count = |phase: Phase| script.commands.iter().filter(|c| c.phase == phase).count();
        let hold_left = count(Phase::Hold);
        Self {
            protocol,
            start: *template.table_from_object().isometry(),
            rise_m: 0.0,
            displacement_m: 0.0,
            penetration_m: 0.0,
            in_palm: Vec::new(),
            last_in_palm: Point3::origin(),
            lift_left: count(Phase::Lift),
            hold_left,
            window: steps(FINAL_WINDOW_S, &template.scene).clamp(1, hold_left),
            control_s: template.scene.control_step_s(),
            pressed: vec![0; template.hand.bodies_n()],
        }
    }

    /// Takes in the state after a command; returns the verdict if it is certain.
    fn see(&mut self, template: &Template, world: &World, command: &Command) -> Option<Verdict> {
        let object = table_from_object(template, world);
        if implausible(template, world, &object) {
            return Some(Verdict::Diverged);
        }
        self.rise_m = object.translation.z - self.start.translation.z;
        self.last_in_palm = template
            .hand
            .table_from_palm(world)
            .inverse_transform_point(&Point3::from(object.translation.vector));
        match command.phase {
            Phase::Reach | Phase::Close => {
                let moved = object.translation.vector - self.start.translation.vector;
                self.displacement_m = moved.norm();
                let turned = object.rotation.angle_to(&self.start.rotation);
                (self.displacement_m > self.protocol.knocked_m
                    || turned > self.protocol.knocked_rad)
                    .then_some(Verdict::KnockedOver)
            }
            Phase::Squeeze => None,
            Phase::Lift => {
                self.feel(template, world);
                self.lift_left = self.lift_left.saturating_sub(1);
                if self.lift_left > 0 {
                    return None;
                }
                self.in_palm.push(self.last_in_palm);
                (self.rise_m <= self.protocol.lifted_m).then_some(Verdict::NotGrasped)
            }
            Phase::Hold => {
                let felt = self.feel(template, world);
                self.in_palm.push(self.last_in_palm);
                if self.hold_left <= self.window {
                    for (count, pressed) in self.pressed.iter_mut().zip(felt.bodies) {
                        *count += usize::from(pressed);
                    }
                }
                self.hold_left = self.hold_left.saturating_sub(1);
                (self.rise_m <= self.protocol.lifted_m).then_some(Verdict::Dropped)
            }
        }
    }

    /// Notes how deep hand and object overlap while the object is carried.
    fn feel(&mut self, template: &Template, world: &World) -> Touch {
        let felt = touch(world, template.object, template.hand.bodies_n());
        self.penetration_m = self.penetration_m.max(felt.depth_m);
        felt
    }

    /// Judges a rollout that was carried out to the end.
    fn conclude(&self) -> Verdict {
        if self.contacts_n() < self.protocol.min_links {
            return Verdict::Dropped;
        }
        let back = self.in_palm.len().saturating_sub(self.window + 1);
        let slipped = self
            .in_palm
            .get(back)
            .map_or(0.0, |before| (self.last_in_palm - before).norm());
        let seconds = self.window as f64 * self.control_s;
        if slipped > self.protocol.max_slip_m_per_s * seconds {
            Verdict::Slipped
        } else {
            Verdict::Held
        }
    }

    fn slip_m(&self) -> f64 {
        self.in_palm
            .first()
            .map_or(0.0, |lifted| (self.last_in_palm - lifted).norm())
    }

    fn contacts_n(&self) -> u32 {
        let enough = TOUCHING_SHARE * self.window as f64;
        let touching = self.pressed.iter().filter(|&&n| n as f64 >= enough);
        u32::try_from(touching.count()).unwrap_or(u32::MAX)
    }
}

/// Whether the state lies outside what can happen in this scene.
fn implausible(template: &Template, world: &World, table_from_object: &Isometry3<f64>) -> bool {
    let numbers = table_from_object
        .translation
        .vector
        .iter()
        .chain(table_from_object.rotation.coords.iter());
    let finite = numbers.into_iter().all(|number| number.is_finite());
    let far = table_from_object.translation.vector.norm() > IMPLAUSIBLE_DISTANCE_M;
    let speed = world.bodies.get(template.object).map_or(f32::NAN, |body| {
        body.linvel().length().max(body.angvel().length())
    });
    let slow = |speed: f32| speed <= IMPLAUSIBLE_SPEED;
    // A comparison with NaN is false, so that NaN is implausible.
    !finite || far || !slow(speed) || !slow(template.hand.fastest(world))
}
