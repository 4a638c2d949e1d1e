//! Execution of one motion in physics, and its verdict.

use motion::HandState;
use schemas::rollouts::{Measures, Verdict};
use spatial::{Object, Palm, Pose, Table};

use crate::{
    config::Protocol,
    contact::{ContactPoint, contact_points, self_depth_m},
    desired::DesiredStep,
    judge::Judge,
    palm_compliance::CompliantPalm,
    palm_course::PalmCourse,
    script::{Command, Phase, Script},
    settled_scene::SettledScene,
    shortcuts::Shortcuts,
    units::EngineFrame,
    world::{Overflow, World},
};

/// Whether a rollout's steps are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TraceMode {
    /// Only the verdict and its figures.
    Nothing,
    /// Every control step too.
    Trace,
}

/// The result of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// The verdict; success is [`Verdict::Held`].
    pub verdict: Verdict,
    /// What was measured.
    pub measures: Measures,
    /// The hand as it moved over the control steps of the reach, its start first; empty unless the reach was simulated
    /// to its end.
    pub executed: Vec<HandState<Object>>,
    /// The steps, if they were requested and anything was simulated.
    pub trace: Option<Trace>,
}

impl Rollout {
    /// Returns the result of a motion refused on geometry alone.
    pub(crate) fn refused(verdict: Verdict, script: &Script) -> Self {
        Self {
            verdict,
            measures: Measures {
                skipped_steps_n: Some(count(script.commands.len())),
                ..Measures::default()
            },
            executed: Vec::new(),
            trace: None,
        }
    }
}

fn count(steps: usize) -> u32 {
    u32::try_from(steps).unwrap_or(u32::MAX)
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
    pub table_from_palm: Pose<Table, Palm>,
    /// Joint positions in radians.
    pub q: Vec<f64>,
    /// Commanded joint positions in radians.
    pub q_command: Vec<f64>,
    /// Pose of the object in the table frame.
    pub table_from_object: Pose<Table, Object>,
    /// Contacts of the hand with the object.
    pub contacts: Vec<ContactPoint>,
}

/// Decision of the observer of a rollout after each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepDecision {
    /// Continues as the motion says.
    Continue,
    /// The palm halts, and the fingers' commands stay constant.
    Hold,
}

/// A watched rollout.
#[derive(Debug, Clone, PartialEq)]
pub struct WatchedRollout {
    /// The result of the motion, with its trace; of an aborted one, the verdict is meaningless.
    pub rollout: Rollout,
    /// Whether it was aborted.
    pub aborted: bool,
}

/// The observer of each step, and the hold time of an aborted motion.
pub(crate) struct StepObserver<'a> {
    pub(crate) see: &'a mut dyn FnMut(&TraceStep) -> StepDecision,
    pub(crate) hold_n: u32,
}

/// Executes a script in a copy of the settled scene.
pub(crate) fn run(
    settled: &SettledScene,
    script: &Script,
    protocol: &Protocol,
    record: TraceMode,
) -> Rollout {
    run_watched(settled, script, protocol, record, None).rollout
}

/// As [`run`], with an observer that may abort it, which needs a trace.
pub(crate) fn run_watched<'a>(
    settled: &'a SettledScene,
    script: &Script,
    protocol: &Protocol,
    record: TraceMode,
    observer: Option<StepObserver<'a>>,
) -> WatchedRollout {
    let shortcuts = match record {
        TraceMode::Nothing => settled.scene.shortcuts,
        TraceMode::Trace => Shortcuts::NONE,
    };
    let mut judge = Judge::new(settled, protocol, script, shortcuts);
    let mut verdict = None;
    let hold_n = observer.as_ref().map_or(0, |observer| observer.hold_n);
    let mut execution = Execution::begin(settled, script, protocol, record, observer);
    let mut aborted = None;
    for (idx, command) in script.commands.iter().enumerate() {
        if execution.flow == StepDecision::Hold {
            aborted = Some(idx.checked_sub(1));
            break;
        }
        verdict = match execution.advance(script, idx, command) {
            Ok(()) => match judge.observe(settled, &execution.world, command) {
                Some(Verdict::Diverged) => Some(Verdict::Diverged),
                _ if execution.is_overloaded() => Some(Verdict::Overloaded),
                judged => judged,
            },
            Err(Overflow) => Some(Verdict::Diverged),
        };
        if verdict.is_some() {
            break;
        }
    }
    // Repeat the last command: the palm stands still, and the fingers keep pressing.
    let last = aborted.flatten();
    if let Some((idx, command)) = last.and_then(|idx| Some((idx, script.commands.get(idx)?))) {
        for _ in 0..hold_n {
            if execution.advance(script, idx, command).is_err() {
                verdict = Some(Verdict::Diverged);
                break;
            }
        }
    }
    let Execution {
        control_steps_n,
        finger_penetration_m,
        executed,
        trace,
        ..
    } = execution;
    let has_reached = aborted.is_none()
        && executed.len() > script.reach_len()
        && verdict != Some(Verdict::Diverged);
    let verdict = verdict.unwrap_or_else(|| judge.conclude(settled));
    let rollout = Rollout {
        verdict,
        measures: Measures {
            control_steps_n,
            skipped_steps_n: Some(count(script.commands.len()).saturating_sub(control_steps_n)),
            finger_penetration_m: finger_penetration_m.filter(|depth_m| depth_m.is_finite()),
            ..judge.measures()
        },
        executed: if has_reached { executed } else { Vec::new() },
        trace: trace.filter(|_| verdict != Verdict::Diverged),
    };
    WatchedRollout {
        rollout,
        aborted: aborted.is_some(),
    }
}

/// Execution of a script in a copy of the settled scene.
struct Execution<'a> {
    settled: &'a SettledScene,
    world: World,
    table_from_estimate: Pose<Table, Object>,
    /// First command from which on the palm is only carried.
    arrival: usize,
    /// The palm's course, if it is driven.
    palm: Option<PalmCourse>,
    /// The palm's deviation from its path, if it yields.
    compliant: Option<CompliantPalm>,
    /// Whether the palm was halted.
    halted: bool,
    /// Whether every pull begins where the first one began.
    restart_each_pull: bool,
    /// The world before the first pull, a palm that yields, and the control steps commanded until then.
    before_pulls: Option<(World, Option<CompliantPalm>, u32)>,
    /// Control steps commanded since the start, by the clock of the drives.
    commanded_n: u32,
    control_steps_n: u32,
    /// Depth of the fingers in each other and in the palm, from the start on; none if they do not touch.
    finger_penetration_m: Option<f64>,
    /// The hand after each control step of the reach, its start first.
    executed: Vec<HandState<Object>>,
    trace: Option<Trace>,
    observer: Option<StepObserver<'a>>,
    /// The observer's latest decision.
    flow: StepDecision,
}

impl<'a> Execution<'a> {
    fn begin(
        settled: &'a SettledScene,
        script: &Script,
        protocol: &Protocol,
        record: TraceMode,
        observer: Option<StepObserver<'a>>,
    ) -> Self {
        let start = &script.start;
        let palm = settled.palm_course(script);
        let mut execution = Self {
            settled,
            world: settled.world.fork(),
            table_from_estimate: settled.table_from_estimate(),
            arrival: palm
                .as_ref()
                .map_or_else(|| script.arrival(), PalmCourse::control_step_count),
            palm,
            compliant: None,
            halted: false,
            restart_each_pull: protocol.published().restart_each_pull,
            before_pulls: None,
            commanded_n: 0,
            control_steps_n: 0,
            finger_penetration_m: settled.scene.is_finger_depth_defined().then_some(0.0),
            executed: Vec::with_capacity(script.reach_len() + 1),
            trace: (record == TraceMode::Trace).then(Trace::default),
            observer,
            flow: StepDecision::Continue,
        };
        let table_from_palm = start.table_from_palm(&execution.table_from_estimate);
        settled
            .hand
            .place(&mut execution.world, &table_from_palm, &start.hand.q_rad);
        let engine_from_palm = settled.hand.engine_from_palm(&execution.world);
        execution.compliant = CompliantPalm::at_rest(&settled.scene, engine_from_palm);
        execution.executed.push(start.hand.clone());
        execution.record(&start.hand.q_rad);
        execution
    }

    /// Advances by one control step with this command of a script.
    ///
    /// # Errors
    ///
    /// Fails if a body's numbers overflowed in it.
    fn advance(&mut self, script: &Script, idx: usize, command: &Command) -> Result<(), Overflow> {
        let (settled, world) = (self.settled, &mut self.world);
        let control_s = settled.scene.control_step_s();
        let is_moving = idx < self.arrival;
        if is_moving {
            if self.palm.is_none() && self.compliant.is_none() {
                let target = command.table_from_palm(&self.table_from_estimate);
                settled.hand.move_palm(world, &target, control_s);
            }
        } else {
            // A palm that yields goes on to move.
            if !self.halted && self.compliant.is_none() {
                settled.hand.halt(world);
                self.halted = true;
            }
            world.carry(settled.object, &command.carried_in_table_m, control_s);
        }
        if command.phase == Phase::Pull {
            if self.restart_each_pull {
                let before = idx.checked_sub(1).and_then(|idx| script.commands.get(idx));
                let turns = before
                    .is_some_and(|b| b.pull_in_table_m_per_s2 != command.pull_in_table_m_per_s2);
                match &self.before_pulls {
                    None => {
                        let compliant = self.compliant.clone();
                        self.before_pulls = Some((world.fork(), compliant, self.commanded_n));
                    }
                    Some((before_pulls, compliant, commanded_n)) if turns => {
                        *world = before_pulls.fork();
                        self.compliant.clone_from(compliant);
                        self.commanded_n = *commanded_n;
                    }
                    Some(_) => {}
                }
            }
            world.pull(settled.object, &command.pull_in_table_m_per_s2);
        }
        let palm = match (&self.palm, &mut self.compliant) {
            (Some(course), _) if is_moving => PalmMotion::Driven(course),
            (_, Some(compliant)) => {
                // The engine's frame is carried, not the palm in it.
                let on_path = self.table_from_estimate * command.hand.frame_from_palm;
                PalmMotion::Compliant(compliant, Pose::new(*on_path))
            }
            _ => PalmMotion::Set,
        };
        let first_step = self.commanded_n as usize * settled.scene.steps_per_control as usize;
        let stepped = |world: &World| {
            // The contacts of a physics step are those at its start: the first one's are the starting posture's.
            if let Some(deepest_m) = &mut self.finger_penetration_m {
                *deepest_m = deepest_m.max(self_depth_m(world));
            }
        };
        let advanced = control_step(settled, world, script, idx, first_step, palm, stepped);
        self.commanded_n += 1;
        self.control_steps_n += 1;
        if command.phase.is_reach() {
            let table_from_palm = settled.hand.table_from_palm(world);
            self.executed.push(HandState {
                frame_from_palm: self.table_from_estimate.inverse() * table_from_palm,
                q_rad: settled.hand.positions(world),
            });
        }
        self.record(&command.hand.q_rad);
        advanced
    }

    /// Whether a palm that yields is too far off its path.
    fn is_overloaded(&self) -> bool {
        self.compliant
            .as_ref()
            .is_some_and(CompliantPalm::is_overloaded)
    }

    /// Records the current state and calls the observer.
    fn record(&mut self, q_command: &[f64]) {
        let Some(trace) = &mut self.trace else {
            return;
        };
        let time_s = f64::from(self.control_steps_n) * self.settled.scene.control_step_s();
        let step = trace_step(self.settled, &self.world, time_s, q_command);
        if let Some(observer) = &mut self.observer {
            self.flow = (observer.see)(&step);
        }
        trace.steps.push(step);
    }
}

/// Reference of the fingers' drives over one physics step.
enum Reference<'a> {
    /// Positions that are held.
    Held(&'a [f64]),
    /// A motion that goes on.
    Moving(DesiredStep),
}

/// Returns the reference that has arrived at the drives `step` physics steps after the start,
/// [`DriveConfig::delay_s`] after it was commanded: nothing is commanded after the control step `last`.
///
/// [`DriveConfig::delay_s`]: crate::DriveConfig::delay_s
fn arrived<'a>(
    settled: &SettledScene,
    script: &'a Script,
    last: usize,
    step: usize,
) -> Option<Reference<'a>> {
    let scene = &settled.scene;
    let Some(commanded) = step.checked_sub(scene.delay_steps()) else {
        return match &script.desired {
            None => Some(Reference::Held(&script.start.hand.q_rad)),
            Some(desired) => desired.before().map(Reference::Moving),
        };
    };
    let per_control = scene.steps_per_control as usize;
    let control_step = commanded / per_control;
    match &script.desired {
        Some(desired) if control_step <= last => {
            let (step_s, within) = (scene.time_step_s, commanded % per_control);
            let desired = desired.during(control_step, within as f64 * step_s, step_s)?;
            Some(Reference::Moving(desired))
        }
        _ => {
            let command = script.commands.get(control_step.min(last))?;
            Some(Reference::Held(&command.hand.q_rad))
        }
    }
}

/// Motion of the palm in one control step.
enum PalmMotion<'a> {
    /// At the velocity that it has.
    Set,
    /// Along the course of a driven palm.
    Driven(&'a PalmCourse),
    /// Off its path, which ends at this pose.
    Compliant(&'a mut CompliantPalm, Pose<EngineFrame, Palm>),
}

/// Advances by one control step from the physics step `first` on, with `last` as the last one commanded; calls
/// `stepped` after each physics step.
fn control_step(
    settled: &SettledScene,
    world: &mut World,
    script: &Script,
    last: usize,
    first: usize,
    mut palm: PalmMotion,
    mut stepped: impl FnMut(&World),
) -> Result<(), Overflow> {
    let per_control = settled.scene.steps_per_control as usize;
    for step in first..first + per_control {
        match &mut palm {
            PalmMotion::Set => {}
            PalmMotion::Driven(course) => {
                if let Some(object_from_palm) = course.pose(step, last) {
                    let target = settled.table_from_estimate() * *object_from_palm;
                    let step_s = settled.scene.time_step_s;
                    settled.hand.move_palm(world, &target, step_s);
                }
            }
            PalmMotion::Compliant(palm, end) => {
                palm.move_hand(world, &settled.hand, end, first + per_control - step);
            }
        }
        match arrived(settled, script, last, step) {
            Some(Reference::Held(q_command)) => settled.hand.drive(world, q_command),
            Some(Reference::Moving(desired)) => settled.hand.follow(world, &desired),
            None => {}
        }
        world.step()?;
        settled.hand.limit_speed(world);
        stepped(world);
    }
    Ok(())
}

fn trace_step(settled: &SettledScene, world: &World, time_s: f64, q_command: &[f64]) -> TraceStep {
    TraceStep {
        time_s,
        table_from_palm: settled.hand.table_from_palm(world),
        q: settled.hand.positions(world),
        q_command: q_command.to_vec(),
        table_from_object: settled.table_from_object_in(world),
        contacts: contact_points(
            world,
            settled.object,
            settled.hand.links(),
            &world.table_from_engine(),
        ),
    }
}
