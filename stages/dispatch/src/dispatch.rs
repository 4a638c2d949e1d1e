//! The stage: one table of executions per object.

use std::{
    cell::RefCell,
    path::{Component, Path},
};

use cell::{Goal, with_causes};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Outcome, Output, Outputs, Scope, SourceFile, Stage, Sum, Unit,
};
use lake::{ReadInputs, WriteArtifact};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    executions::{self, Execution, Executions},
    objects::Object,
    robustness::RobustnessTable,
    rollouts::Rollouts,
};

use crate::{
    DispatchConfig, DispatchError,
    config::SIMULATED,
    connect::{self, ConnectedCell},
    goals::goal,
    ledger::{CellFacts, Ledger, OpenGoal, signing_key},
    names::JointNames,
    recording::{Setting, record},
    refusal::Refusal,
    robots::Robots,
    rows,
    send_queue::SendQueue,
    sender::{ExecutedDuring, Sender, SentGoal, unknown},
};

/// Sends accepted motions to a robot cell.
pub struct Dispatch;

dataflow::metrics! {
    /// Counts of the motions for an object.
    pub struct DispatchMetrics {
        /// Number of motions considered.
        motions_n: Sum,
        /// Number of those sent, now or before.
        sent_n: Sum,
        /// Number of those not sent because they are infeasible.
        refused_n: Sum,
        /// Number of those that the cell refused.
        rejected_n: Sum,
        /// Number of those that the cell accepted.
        accepted_n: Sum,
        /// Number of those that succeeded.
        succeeded_n: Sum,
        /// Number of those that the cell aborted.
        aborted_n: Sum,
        /// Number of those with an unknown outcome.
        unknown_n: Sum,
        /// Number of those that a person stopped.
        stopped_n: Sum,
        /// Number of those that the cell had executed before this run.
        known_n: Sum,
        /// Number of those that a dry run would have sent.
        dry_n: Sum,
        /// Number of those sent to a simulated cell.
        simulated_n: Sum,
    }
}

impl Stage for Dispatch {
    type Config = DispatchConfig;

    const KIND: &'static str = "dispatch";
    const ABOUT: &'static str = "Sends accepted motions to a robot cell and records their outcomes";
    const INPUTS: &'static [&'static str] = &[
        Rollouts::NAME,
        RobustnessTable::NAME,
        Candidates::NAME,
        Object::NAME,
    ];
    const OUTPUTS: Outputs<Self> = &[&Self];

    /// Checks the credentials and the robot's URDF, and that the robot can satisfy the options.
    fn prepare(config: &DispatchConfig) -> Result<(), BoxedDiagnostic> {
        config.credentials().map_err(DispatchError::from)?;
        let robots = Robots::load(config, &config.hand, |arm| Ok(arm.robot.as_path()))?;
        JointNames::new(&config.joint_names, robots.whole())?;
        robots.planner(config)?;
        Ok(())
    }
}

impl Output for Dispatch {
    type Stage = Self;
    type Metrics = DispatchMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Executions::NAME;
    const SCHEMA: &'static str = Executions::VERSION;
    const PARTITION: &'static str = Executions::PARTITION;
    const EXECUTION: dataflow::Execution = dataflow::Execution::Physical;

    /// A cell that this stage starts itself moves nothing.
    fn execution(config: &DispatchConfig) -> dataflow::Execution {
        if config.cell == SIMULATED {
            dataflow::Execution::OneByOne
        } else {
            Self::EXECUTION
        }
    }

    fn units(config: &DispatchConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let of_hand = robot_meshes::sources(&config.hand)?;
        let of_arm = match &config.arm {
            Some(arm) => robot_meshes::sources(&arm.robot)?,
            None => Vec::new(),
        };
        // Both robots may have a mesh of the same name.
        let of_arm = of_arm.into_iter().map(|mesh| SourceFile {
            name: format!("arm: {}", mesh.name),
            ..mesh
        });
        let meshes: Vec<SourceFile> = of_hand.into_iter().chain(of_arm).collect();
        Ok(scope
            .partitions(Rollouts::NAME)
            .iter()
            .map(|rollouts| {
                let unit = Unit::new(&rollouts.key)
                    .with_label("object", &rollouts.key)
                    .reading(Rollouts::NAME, [&rollouts.key])
                    .reading(RobustnessTable::NAME, [&rollouts.key])
                    .reading(Candidates::NAME, [&rollouts.key])
                    .reading(Object::NAME, [&rollouts.key])
                    .with_file_of_form(
                        SourceFile::named("hand", &config.hand),
                        robot_meshes::URDF_FORM,
                    );
                let unit = match &config.arm {
                    Some(arm) => {
                        let robot = SourceFile::named("arm.robot", &arm.robot);
                        unit.with_file_of_form(robot, robot_meshes::URDF_FORM)
                    }
                    None => unit,
                };
                meshes.iter().cloned().fold(unit, Unit::with_file)
            })
            .collect())
    }

    fn make(
        config: &DispatchConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<DispatchMetrics>, BoxedDiagnostic> {
        let config = &config.resolved();
        let rollouts: Rollouts = inputs.one()?;
        let candidates: Candidates = inputs.one()?;
        let object: Object = inputs.one()?;
        let robustness: RobustnessTable = inputs.one()?;
        let motions = SendQueue::new(config.order, &rollouts, &robustness, &candidates)?;
        let sent = if motions.is_empty() {
            ObjectExecutions::default()
        } else {
            let hand = &inputs.source("hand")?.path;
            let arm = |_: &planning::ArmConfig| Ok(inputs.source("arm.robot")?.path.as_path());
            let robots = Robots::load(config, hand, arm)?;
            send(config, &robots, &object, &candidates, motions, cx)?
        };
        cx.write(&sent.executions)?;
        // A dry run asked the cell of its moment, and another run asks again.
        Ok(if sent.dry_n > 0 {
            Outcome::Provisional(sent.metrics())
        } else {
            Outcome::Made(sent.metrics())
        })
    }
}

/// Results of the motions for one object.
#[derive(Default)]
struct ObjectExecutions {
    executions: Vec<Execution>,
    /// Motions considered.
    motions_n: usize,
    /// Motions that the cell had executed before this run.
    known_n: usize,
    /// Motions that a dry run would have sent.
    dry_n: usize,
}

impl ObjectExecutions {
    fn metrics(&self) -> DispatchMetrics {
        let count = |predicate: &dyn Fn(&Execution) -> bool| {
            self.executions.iter().filter(|&e| predicate(e)).count() as f64
        };
        let ended = |outcome: executions::Outcome| count(&|e| e.outcome == outcome);
        let sent_n = count(&|e| !e.goal_id.is_empty());
        DispatchMetrics {
            motions_n: self.motions_n as f64,
            sent_n,
            refused_n: self.executions.len() as f64 - sent_n,
            rejected_n: count(&|e| {
                e.outcome == executions::Outcome::Rejected && !e.goal_id.is_empty()
            }),
            accepted_n: count(&|e| e.accepted),
            succeeded_n: ended(executions::Outcome::Succeeded),
            aborted_n: ended(executions::Outcome::Aborted),
            unknown_n: ended(executions::Outcome::Unknown),
            stopped_n: ended(executions::Outcome::Stopped),
            known_n: self.known_n as f64,
            dry_n: self.dry_n as f64,
            simulated_n: count(&|e| e.simulated && !e.goal_id.is_empty()),
        }
    }
}

/// A motion as a goal, or why it is not sent.
type PlannedGoal<'a> = (&'a Candidate, Result<Goal, Refusal>);

/// Sends motions one after another.
fn send(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
    candidates: &Candidates,
    motions: SendQueue<'_>,
    cx: &Context,
) -> Result<ObjectExecutions, BoxedDiagnostic> {
    let names = JointNames::new(&config.joint_names, robots.whole())?;
    // Find infeasible motions before anything moves or a cell is queried.
    let goals = planned(config, robots, &names, candidates, motions)?;
    let motions_n = goals.len();
    let mut done = ObjectExecutions {
        motions_n,
        ..ObjectExecutions::default()
    };
    let Some(first) = goals.iter().find_map(|(_, goal)| goal.as_ref().ok()) else {
        done.executions = refused(config, &goals);
        return Ok(done);
    };
    let ledger = ledger(config, cx)?;
    let connected = connect(config, robots, object, first, &ledger, cx)?;
    if !connected.terms.may_send() {
        done.dry_n = goals.iter().filter(|(_, goal)| goal.is_ok()).count();
        return Ok(done);
    }
    let joints = names.joints_on_wire(robots.whole());
    let sender = Sender {
        config,
        client: &connected.client,
        terms: &connected.terms,
        joints: &joints,
        ledger,
        stopped: RefCell::default(),
    };
    sender.settle()?;
    let cell = connected.terms.capabilities();
    for (idx, (candidate, goal)) in goals.into_iter().enumerate() {
        cx.progress(idx as f64 / motions_n as f64, &candidate.candidate_id);
        check_name(candidate)?;
        let sent = match goal {
            Ok(goal) => sender.execute_or_resume(&goal)?,
            Err(refusal) => Err(refusal),
        };
        let SentGoal {
            goal,
            mut report,
            during,
            cell: facts,
        } = match sent {
            Ok(sent) => sent,
            Err(refusal) => {
                let here = CellFacts::of(cell);
                let row = rows::not_sent(&cell.cell, &here, candidate, &refusal);
                done.executions.push(row);
                continue;
            }
        };
        done.known_n += usize::from(during == ExecutedDuring::Before);
        names.to_urdf(&mut report.joints);
        let setting = Setting {
            robots,
            hand_path: &config.hand,
            object,
            cell: &cell.cell,
            gap: &facts.gap,
            object_from_grasp: &candidate.motion.grasp().frame_from_palm,
        };
        record(&setting, &goal, &report, cx.folder())?;
        let row = rows::execution(&cell.cell, &facts, candidate, &report);
        done.executions.push(row);
    }
    Ok(done)
}

/// Returns the executions of motions none of which can be sent.
fn refused(config: &DispatchConfig, goals: &[PlannedGoal]) -> Vec<Execution> {
    let here = CellFacts {
        simulated: config.cell == SIMULATED,
        gap: String::new(),
    };
    let rows = goals.iter().filter_map(|(candidate, goal)| {
        let refusal = goal.as_ref().err()?;
        Some(rows::not_sent(&config.cell_name, &here, candidate, refusal))
    });
    rows.collect()
}

/// Takes the motions that are to be sent, and those that cannot be.
fn planned<'a>(
    config: &DispatchConfig,
    robots: &Robots,
    names: &JointNames,
    candidates: &Candidates,
    mut motions: SendQueue<'a>,
) -> Result<Vec<PlannedGoal<'a>>, DispatchError> {
    let planner = robots.planner(config)?;
    let mut goals: Vec<PlannedGoal<'_>> = Vec::new();
    let mut feasible_n = 0;
    while feasible_n < config.per_object
        && let Some(candidate) = motions.next()
    {
        let goal = goal(config, robots, &planner, names, candidates, candidate);
        if goal.is_ok() {
            feasible_n += 1;
            motions.mark_chosen(candidate);
        }
        goals.push((candidate, goal));
    }
    Ok(goals)
}

/// Connects to the cell; without it the outcome of a goal that was sent before is unknown.
fn connect(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
    first: &Goal,
    ledger: &Ledger,
    cx: &Context,
) -> Result<ConnectedCell, BoxedDiagnostic> {
    let key = match config.cell.as_str() {
        SIMULATED => None,
        _ => Some(signing_key(cx.effects_folder())?),
    };
    connect::connect(config, robots, object, first, key).map_err(|err| {
        let open = ledger.open_goals().unwrap_or_default();
        // A higher `attempt` says that a person has looked.
        let is_now = |open: &OpenGoal| {
            let goal = open.goal.as_ref();
            goal.is_none_or(|goal| goal.attempt >= config.attempt)
        };
        match open.into_iter().find(is_now) {
            Some(OpenGoal { goal, goal_id, .. }) => {
                let candidate_id = goal.map_or("?".to_owned(), |goal| goal.candidate_id);
                unknown(&config.cell_name, &candidate_id, goal_id, with_causes(&err)).into()
            }
            None => err,
        }
    })
}

/// Opens the memory of what was sent to the configured cell; there is none of a cell that ends with this process.
fn ledger(config: &DispatchConfig, cx: &Context) -> Result<Ledger, BoxedDiagnostic> {
    if config.cell == SIMULATED {
        return Ok(Ledger::none());
    }
    let waiting = || {
        let name = &config.cell_name;
        cx.progress(0.0, &format!("waits: another unit sends to cell `{name}`"));
    };
    Ledger::open(cx.effects_folder(), &config.cell_name, waiting)
}

/// Checks that a motion's name is a valid file name.
fn check_name(candidate: &Candidate) -> Result<(), DispatchError> {
    let mut components = Path::new(&candidate.candidate_id).components();
    match (components.next(), components.next()) {
        (Some(Component::Normal(_)), None) => Ok(()),
        _ => Err(DispatchError::CandidateName {
            candidate_id: candidate.candidate_id.clone(),
        }),
    }
}
