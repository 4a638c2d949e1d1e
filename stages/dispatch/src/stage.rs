//! The stage: one table of executions per object.

use std::{
    path::{Component, Path},
    sync::Arc,
};

use cell::{
    CellClient, Goal, GoalResult, Recovered, Rejection, RejectionCode, Report, with_causes,
};
use dataflow::{
    Code, Context, Inputs, OptionFault, Outcome, Output, Outputs, Scope, SourceFile, Stage, Sum,
    Unit,
};
use lake::{LakeError, ReadInputs, WriteArtifact};
use robot::Joint;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    executions::{self, Execution, Executions},
    objects::Object,
    robustness::Robustnesses,
    rollouts::Rollouts,
};

use crate::{
    DispatchConfig, DispatchError, cells,
    config::SIMULATED,
    goals::goal,
    in_flight::MotionInFlight,
    journal::{GoalHistory, Journal},
    names::JointNames,
    order::Queue,
    recording::{Setting, record},
    refusal::Refusal,
    robots::Robots,
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
        /// Number of those that the cell accepted.
        accepted_n: Sum,
        /// Number of those that succeeded.
        succeeded_n: Sum,
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
    type Error = DispatchError;

    const KIND: &'static str = "dispatch";
    const ABOUT: &'static str = "Sends accepted motions to a robot cell and keeps what it did";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [&'static str] = &[
        Rollouts::NAME,
        Robustnesses::NAME,
        Candidates::NAME,
        Object::NAME,
    ];
    const OUTPUTS: Outputs<Self> = &[&Self];

    fn check(config: &DispatchConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the credentials and the robot's URDF, and that the robot can satisfy the options.
    fn prepare(config: &DispatchConfig) -> Result<(), DispatchError> {
        config.credentials()?;
        let robots = Robots::load(config, &config.hand, |arm| Ok(arm.robot.as_path()))?;
        JointNames::new(&config.joint_names, robots.whole())?;
        robots.planner(config).map(drop)
    }
}

impl Output for Dispatch {
    type Stage = Self;
    type Metrics = DispatchMetrics;
    type Error = DispatchError;

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

    fn units(config: &DispatchConfig, scope: &Scope) -> Result<Vec<Unit>, DispatchError> {
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
                    .reading(Robustnesses::NAME, [&rollouts.key])
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
    ) -> Result<Outcome<DispatchMetrics>, DispatchError> {
        let rollouts: Rollouts = inputs.one()?;
        let candidates: Candidates = inputs.one()?;
        let object: Object = inputs.one()?;
        let robustness: Robustnesses = inputs.one()?;
        let motions = Queue::new(config.order, &rollouts, &robustness, &candidates)?;
        let sent = if motions.is_empty() {
            ObjectExecutions::default()
        } else {
            let hand = &inputs.source("hand")?.path;
            let arm = |_: &planning::ArmConfig| Ok(inputs.source("arm.robot")?.path.as_path());
            let robots = Robots::load(config, hand, arm)?;
            send(config, &robots, &object, &candidates, motions, cx)?
        };
        cx.write(&sent.executions)?;
        Ok(Outcome::Made(sent.metrics()))
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
    simulated: bool,
}

impl ObjectExecutions {
    fn metrics(&self) -> DispatchMetrics {
        let count = |so: &dyn Fn(&Execution) -> bool| {
            self.executions.iter().filter(|&e| so(e)).count() as f64
        };
        let ended = |outcome: executions::Outcome| count(&|e| e.outcome == outcome);
        let sent_n = count(&|e| !e.goal_id.is_empty());
        DispatchMetrics {
            motions_n: self.motions_n as f64,
            sent_n,
            refused_n: self.executions.len() as f64 - sent_n,
            accepted_n: count(&|e| e.accepted),
            succeeded_n: ended(executions::Outcome::Succeeded),
            unknown_n: ended(executions::Outcome::Unknown),
            stopped_n: ended(executions::Outcome::Stopped),
            known_n: self.known_n as f64,
            dry_n: self.dry_n as f64,
            simulated_n: if self.simulated { sent_n } else { 0.0 },
        }
    }
}

/// Sends motions one after another.
fn send(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
    candidates: &Candidates,
    mut motions: Queue<'_>,
    cx: &Context,
) -> Result<ObjectExecutions, DispatchError> {
    let planner = robots.planner(config)?;
    let names = JointNames::new(&config.joint_names, robots.whole())?;
    // Find infeasible motions before anything moves or a cell is queried.
    let mut goals: Vec<(&Candidate, Result<Goal, Refusal>)> = Vec::new();
    let mut feasible_n = 0;
    while feasible_n < config.per_object
        && let Some(candidate) = motions.next()
    {
        let goal = goal(config, robots, &planner, &names, candidates, candidate);
        if goal.is_ok() {
            feasible_n += 1;
            motions.send(candidate);
        }
        goals.push((candidate, goal));
    }
    let motions_n = goals.len();
    if feasible_n == 0 {
        let rows = goals.iter().filter_map(|(candidate, goal)| {
            let refusal = goal.as_ref().err()?;
            let cell = Cell {
                name: &config.cell_name,
                simulated: config.cell == SIMULATED,
                gap: "",
            };
            Some(cell.refused(candidate, refusal))
        });
        return Ok(ObjectExecutions {
            executions: rows.collect(),
            motions_n,
            ..ObjectExecutions::default()
        });
    }
    let journal = Journal::new(cx.resume_folder().to_owned());
    let joints = names.joints_on_wire(robots.whole());
    let mut feasible = goals.iter().filter_map(|(_, goal)| goal.as_ref().ok());
    let first = feasible.clone().next().ok_or_else(|| missing("motion"))?;
    let connected = cells::connect(config, robots, object, first).map_err(|err| {
        // The outcome of an earlier run's motion is unknown until a cell can be queried.
        let is_open = |goal: &&Goal| matches!(journal.history(goal, &joints), GoalHistory::Sent(_));
        match feasible.find(is_open) {
            Some(goal) => unknown(&config.cell_name, goal, with_causes(&err)),
            None => err,
        }
    })?;
    let capabilities = &connected.capabilities;
    let mut sent = ObjectExecutions {
        simulated: capabilities.simulated,
        motions_n,
        ..ObjectExecutions::default()
    };
    if !config.permits(capabilities) {
        sent.dry_n = feasible_n;
        return Ok(sent);
    }
    let cell = Cell {
        name: &capabilities.cell,
        simulated: capabilities.simulated,
        gap: &capabilities.gap,
    };
    let sender = Sender {
        config,
        client: &connected.client,
        cell: &capabilities.cell,
        cell_journal: &capabilities.journal,
        joints: &joints,
        journal,
    };
    for (idx, (candidate, goal)) in goals.iter().enumerate() {
        cx.progress(idx as f64 / motions_n as f64, &candidate.candidate_id);
        check_name(candidate)?;
        let goal = match goal {
            Ok(goal) => goal,
            Err(refusal) => {
                sent.executions.push(cell.refused(candidate, refusal));
                continue;
            }
        };
        let bytes = goal.encode().bytes.len();
        if bytes > capabilities.max_goal_bytes {
            let most = capabilities.max_goal_bytes;
            let refusal = Refusal::Long { bytes, most };
            sent.executions.push(cell.refused(candidate, &refusal));
            continue;
        }
        let (goal, mut report, moved) = sender.execute_or_resume(goal)?;
        sent.known_n += usize::from(moved == ExecutedDuring::Before);
        names.of_hand(&mut report.joints);
        let setting = Setting {
            robots,
            hand_path: &config.hand,
            object,
            cell: &capabilities.cell,
            gap: &capabilities.gap,
            object_from_grasp: &candidate.motion.grasp().frame_from_palm,
        };
        record(&setting, &goal, &report, cx.folder())?;
        sent.executions.push(cell.execution(candidate, &report));
    }
    Ok(sent)
}

/// Time of a goal's execution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ExecutedDuring {
    /// During this process.
    Now,
    /// For this unit, during an earlier process or between processes.
    Earlier,
    /// For another dispatcher or unit, before.
    Before,
}

/// Sends goals, each at most once even if this process is killed.
struct Sender<'a> {
    config: &'a DispatchConfig,
    client: &'a Arc<CellClient>,
    cell: &'a str,
    /// The name of the cell's own goal journal.
    cell_journal: &'a str,
    /// The robot's joints under the goals' names.
    joints: &'a [Joint],
    journal: Journal,
}

impl Sender<'_> {
    /// As [`Sender::carry_out`]; a motion stopped before this run is sent again as a new goal if
    /// the options say so. Returns the goal that ended.
    fn execute_or_resume(
        &self,
        goal: &Goal,
    ) -> Result<(Goal, Report, ExecutedDuring), DispatchError> {
        let mut goal = goal.clone();
        loop {
            let (report, moved) = self.carry_out(&goal)?;
            if report.outcome != executions::Outcome::Stopped {
                return Ok((goal, report, moved));
            }
            if moved == ExecutedDuring::Now {
                return Err(DispatchError::Stopped {
                    cell: self.cell.to_owned(),
                    candidate_id: goal.candidate_id.clone(),
                    goal_id: report.goal_id,
                    message: report.message,
                });
            }
            if !self.config.resume_stopped {
                return Ok((goal, report, moved));
            }
            goal.resumed += 1;
        }
    }

    /// Executes a goal, or queries its outcome if it was sent before.
    ///
    /// Without an answer, or with one that fails its checks, the run ends: nothing more is sent to
    /// this robot until a person has looked, and the next run queries the cell again.
    fn carry_out(&self, goal: &Goal) -> Result<(Report, ExecutedDuring), DispatchError> {
        let id = goal.encode().goal_id;
        if let GoalHistory::Over(report) = self.journal.history(goal, self.joints) {
            return Ok((*report, ExecutedDuring::Earlier));
        }
        let answer = self.config.answer_timeout();
        let motion = MotionInFlight::new(self.client, &goal.candidate_id, self.cell, &id, answer);
        motion.carry_out(|| self.send_or_recover(goal))
    }

    fn send_or_recover(&self, goal: &Goal) -> Result<(Report, ExecutedDuring), DispatchError> {
        let (answer, result) = (self.config.answer_timeout(), self.config.result_timeout());
        let id = goal.encode().goal_id;
        let unknown = |message: String| unknown(self.cell, goal, message);
        match self.journal.history(goal, self.joints) {
            GoalHistory::Over(report) => return Ok((*report, ExecutedDuring::Earlier)),
            GoalHistory::New => {
                // A second cell of the same name may have started: it would move too.
                self.client.capabilities(answer)?;
                self.journal.send(&id, self.cell_journal)?;
            }
            GoalHistory::Sent(to) => {
                // Another cell's `never_taken` says nothing about the cell that received the goal.
                if to != self.cell_journal {
                    let message = format!(
                        "it was sent to the cell with journal `{to}`, the one that answers has `{}`",
                        self.cell_journal
                    );
                    return Err(unknown(message));
                }
                match self.client.recover(goal, self.joints, answer, result) {
                    Recovered::Report(report) => {
                        self.journal.conclude(&report)?;
                        return Ok((report, ExecutedDuring::Earlier));
                    }
                    // Only a goal that the cell never accepted is sent again, under its own id.
                    Recovered::NeverTaken => {}
                    Recovered::NoAnswer(message) => return Err(unknown(message)),
                }
                let there = self.client.capabilities(answer);
                there.map_err(|err| unknown(with_causes(&err)))?;
            }
        }
        let done = match self.client.execute(goal, self.joints, answer, result)? {
            GoalResult::Report(report) => (report, ExecutedDuring::Now),
            GoalResult::EarlierReport(report) => (report, ExecutedDuring::Before),
            GoalResult::Unknown(message) => return Err(unknown(message)),
        };
        let (report, moved) = done;
        if report.outcome != executions::Outcome::Rejected {
            self.journal.conclude(&report)?;
            return Ok((report, moved));
        }
        self.journal.withdraw(&id)?;
        match report.rejection.as_ref().filter(|it| is_temporary(it)) {
            None => Ok((report, moved)),
            Some(rejection) => Err(DispatchError::NotNow {
                cell: self.cell.to_owned(),
                candidate_id: goal.candidate_id.clone(),
                reason: rejection.reason.clone(),
            }),
        }
    }
}

/// Returns the error for a motion with an unknown outcome.
fn unknown(cell: &str, goal: &Goal, message: String) -> DispatchError {
    DispatchError::Unknown {
        cell: cell.to_owned(),
        candidate_id: goal.candidate_id.clone(),
        goal_id: goal.encode().goal_id,
        message,
    }
}

/// Whether a refusal is temporary: the motion may be accepted later.
fn is_temporary(rejection: &Rejection) -> bool {
    matches!(
        rejection.code,
        RejectionCode::Busy
            | RejectionCode::Stopped
            | RejectionCode::Expired
            | RejectionCode::Clock
            | RejectionCode::Storage
    )
}

/// The cell's columns of a row.
struct Cell<'a> {
    name: &'a str,
    simulated: bool,
    gap: &'a str,
}

impl Cell<'_> {
    /// Returns the row of a motion that was sent.
    fn execution(&self, candidate: &Candidate, report: &Report) -> Execution {
        Execution {
            goal_id: report.goal_id.clone(),
            candidate_id: candidate.candidate_id.clone(),
            cell: self.name.to_owned(),
            simulated: self.simulated,
            gap: self.gap.to_owned(),
            accepted: !matches!(
                report.outcome,
                executions::Outcome::Rejected | executions::Outcome::Unknown
            ),
            outcome: report.outcome,
            message: report.message.clone(),
            duration_s: report.duration_s(),
            tracking_error_rad: report.tracking_error_rad(),
            lift_m: report.lift_m,
        }
    }

    /// Returns the row of a motion that was not sent.
    fn refused(&self, candidate: &Candidate, refusal: &Refusal) -> Execution {
        Execution {
            goal_id: String::new(),
            candidate_id: candidate.candidate_id.clone(),
            cell: self.name.to_owned(),
            simulated: self.simulated,
            gap: self.gap.to_owned(),
            accepted: false,
            outcome: executions::Outcome::Rejected,
            message: refusal.to_string(),
            duration_s: 0.0,
            tracking_error_rad: 0.0,
            lift_m: 0.0,
        }
    }
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

fn missing(what: &'static str) -> LakeError {
    LakeError::MissingInput { what }
}
