//! The stage: one table of executions per object.

use std::{
    collections::BTreeMap,
    path::{Component, Path},
};

use cell::{CellClient, Executed, Goal, Recovered, Rejection, RejectionCode, Report};
use dataflow::{
    Artifact, Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, SourceFile,
    Stage, Summary, Unit,
};
use schemas::{
    SchemaError,
    candidates::{self, Candidate, Candidates},
    executions::{self, Execution},
    objects::{self, Object},
    rollouts,
};

use crate::{
    DispatchConfig, DispatchError, cells,
    config::SIMULATED,
    feasible::Planner,
    goals::{accepted, goal},
    journal::{Journal, Past},
    names::JointNames,
    recording::{Setting, record},
    refusal::Refusal,
    robots::Robots,
    trials::{self, EXECUTIONS, TRIALS},
};

/// Sends accepted motions to a robot cell.
pub enum Dispatch {}

impl Stage for Dispatch {
    type Config = DispatchConfig;
    type Error = DispatchError;

    const KIND: &'static str = "dispatch";
    const ABOUT: &'static str = "Sends accepted motions to a robot cell and keeps what it did";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "rollouts",
            artifact: "rollouts",
        },
        Input {
            name: "candidates",
            artifact: "candidates",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
    ];
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: EXECUTIONS,
            schema: executions::VERSION,
            partition: "object",
            parallel: false,
        },
        Output {
            artifact: TRIALS,
            schema: schemas::trials::VERSION,
            partition: "dispatching",
            parallel: true,
        },
    ];

    /// Checks the options and the hand's URDF.
    fn prepare(config: &DispatchConfig) -> Result<(), DispatchError> {
        config.check()?;
        let arm = config.arm.as_ref().map(|arm| arm.robot.as_path());
        let robots = Robots::load(config, &config.hand, arm)?;
        JointNames::new(&config.joint_names, robots.whole())?;
        Planner::new(config, &robots).map(drop)
    }

    fn units(
        config: &DispatchConfig,
        output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, DispatchError> {
        if output == TRIALS {
            return Ok(trials::units(scope));
        }
        Ok(scope
            .partitions("rollouts")
            .iter()
            .map(|rollouts| {
                let unit = Unit::new(&rollouts.key)
                    .reading("rollouts", [&rollouts.key])
                    .reading("candidates", [&rollouts.key])
                    .reading("objects", [&rollouts.key])
                    .with_file(SourceFile::named_by_file(&config.hand));
                match &config.arm {
                    Some(arm) => unit.with_file(SourceFile::named_by_file(&arm.robot)),
                    None => unit,
                }
            })
            .collect())
    }

    fn foretell(
        _config: &DispatchConfig,
        output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        if output == TRIALS {
            return Some(Labels::new());
        }
        let object = unit.partition.clone();
        Some(Labels::from([("object".to_owned(), object)]))
    }

    /// How often motions succeed goes by what is known of each.
    fn decides(_option: &str, output: &str) -> bool {
        output == EXECUTIONS
    }

    fn run(
        config: &DispatchConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, DispatchError> {
        if cx.output() == TRIALS {
            return trials::make(inputs, cx);
        }
        config.check()?;
        let schema = |source: SchemaError| DispatchError::Schema {
            partition: cx.partition().to_owned(),
            source,
        };
        let artifact = |input| only(inputs, input, cx);
        let rollouts =
            rollouts::from_batch(&lake::table::read(artifact("rollouts")?)?).map_err(schema)?;
        let artifact_of_candidates = artifact("candidates")?;
        let candidates = candidates::from_batch(
            &artifact_of_candidates.key,
            &lake::table::read(artifact_of_candidates)?,
        )
        .map_err(schema)?;
        let artifact_of_object = artifact("objects")?;
        let object = objects::from_batch(
            &artifact_of_object.key,
            &lake::table::read(artifact_of_object)?,
        )
        .map_err(schema)?;
        let motions = accepted(&rollouts, &candidates)?;
        let sent = if motions.is_empty() {
            Sent::default()
        } else {
            let mut files = inputs.files().iter().map(|file| file.path.as_path());
            let hand = files.next().ok_or_else(|| missing(cx, "URDF of a hand"))?;
            let robots = Robots::load(config, hand, files.next())?;
            send(config, &robots, &object, &candidates, &motions, cx)?
        };
        let batch = executions::to_batch(&sent.executions).map_err(schema)?;
        lake::table::write(cx.folder(), &batch)?;
        Ok(Outcome::Made(Made {
            labels: BTreeMap::from([("object".to_owned(), object.name)]),
            metrics: sent.metrics(),
        }))
    }

    fn describe(output: &str, summary: &Summary) -> String {
        if output == TRIALS {
            return trials::describe(summary);
        }
        let motions = summary.total("motions_n");
        if motions == 0.0 {
            return "no accepted motion to execute".to_owned();
        }
        let dry = summary.total("dry_n");
        if dry > 0.0 {
            return format!(
                "{dry} of {motions} motions would be sent; nothing moved, because `execute` is not set"
            );
        }
        let cell = if summary.total("simulated_n") > 0.0 {
            "the simulated cell"
        } else {
            "the robot cell"
        };
        let succeeded = summary.total("succeeded_n");
        let mut line = format!("{motions} motions → {succeeded} executed with success by {cell}");
        let unknown = summary.total("unknown_n");
        let refused = summary.total("refused_n");
        if refused > 0.0 {
            line = format!("{line}; {refused} not sent, the robot cannot make them");
        }
        let known = summary.total("known_n");
        if known > 0.0 {
            line = format!(
                "{line}; {known} the cell had executed before and did not again (raise `attempt` to have it)"
            );
        }
        if unknown > 0.0 {
            line = format!("{line}; {unknown} unknown, look at the robot before going on");
        }
        line
    }
}

/// What became of the motions of one object.
#[derive(Default)]
struct Sent {
    executions: Vec<Execution>,
    /// Motions that were looked at.
    motions_n: usize,
    /// Motions that the cell had executed before, and did not again.
    known_n: usize,
    /// Motions that would have been sent.
    dry_n: usize,
    simulated: bool,
}

impl Sent {
    fn metrics(&self) -> BTreeMap<String, f64> {
        let count =
            |so: &dyn Fn(&Execution) -> bool| self.executions.iter().filter(|&e| so(e)).count();
        let sent_n = count(&|e| !e.goal_id.is_empty());
        [
            ("motions_n", self.motions_n),
            ("sent_n", sent_n),
            ("refused_n", self.executions.len() - sent_n),
            ("accepted_n", count(&|e| e.accepted)),
            (
                "succeeded_n",
                count(&|e| e.outcome == executions::Outcome::Succeeded),
            ),
            (
                "unknown_n",
                count(&|e| e.outcome == executions::Outcome::Unknown),
            ),
            ("known_n", self.known_n),
            ("dry_n", self.dry_n),
            ("simulated_n", if self.simulated { sent_n } else { 0 }),
        ]
        .map(|(name, count)| (name.to_owned(), count as f64))
        .into()
    }
}

/// Sends motions one after another, each when the one before is over.
fn send(
    config: &DispatchConfig,
    robots: &Robots,
    object: &Object,
    candidates: &Candidates,
    motions: &[&Candidate],
    cx: &Context,
) -> Result<Sent, DispatchError> {
    let planner = Planner::new(config, robots)?;
    let names = JointNames::new(&config.joint_names, robots.whole())?;
    // What cannot be made is known before anything moves, or a cell is asked.
    let mut goals: Vec<(&Candidate, Result<Goal, Refusal>)> = Vec::new();
    let mut feasible_n = 0;
    for &candidate in motions {
        if feasible_n == config.per_object {
            break;
        }
        let goal = goal(config, robots, &planner, &names, candidates, candidate);
        feasible_n += usize::from(goal.is_ok());
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
        return Ok(Sent {
            executions: rows.collect(),
            motions_n,
            ..Sent::default()
        });
    }
    let connected = cells::connect(config, robots, object)?;
    let capabilities = &connected.capabilities;
    let mut sent = Sent {
        simulated: capabilities.simulated,
        motions_n,
        ..Sent::default()
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
        journal: Journal::new(cx.resume_folder().to_owned()),
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
        let bytes = goal.seal().bytes.len();
        if bytes > capabilities.max_goal_bytes {
            let most = capabilities.max_goal_bytes;
            let refusal = Refusal::Long { bytes, most };
            sent.executions.push(cell.refused(candidate, &refusal));
            continue;
        }
        let (mut report, moved) = sender.carry_out(goal)?;
        sent.known_n += usize::from(moved == Moved::Before);
        names.of_hand(&mut report);
        let grasp = candidate.steps.last();
        let grasp = grasp.map(|step| *step.object_from_palm.isometry());
        let setting = Setting {
            robots,
            hand_path: &config.hand,
            object,
            cell: &capabilities.cell,
            gap: &capabilities.gap,
            object_from_grasp: &grasp.unwrap_or_default(),
        };
        record(&setting, goal, &report, cx.folder())?;
        sent.executions.push(cell.execution(candidate, &report));
    }
    Ok(sent)
}

/// When a goal was carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Moved {
    /// For this unit, if not for this process.
    Now,
    /// For somebody else before, and not again.
    Before,
}

/// Sends goals, each at most once whatever becomes of this process.
struct Sender<'a> {
    config: &'a DispatchConfig,
    client: &'a CellClient,
    cell: &'a str,
    journal: Journal,
}

impl Sender<'_> {
    /// Has a goal carried out, or finds out what became of it when it was sent before.
    ///
    /// Where nothing is heard of it the run ends: until somebody has looked, nothing more is sent to
    /// this robot, and the next run asks the cell again.
    fn carry_out(&self, goal: &Goal) -> Result<(Report, Moved), DispatchError> {
        let (answer, result) = (self.config.answer_timeout(), self.config.result_timeout());
        let id = goal.seal().goal_id;
        let unknown = |message: String| DispatchError::Unknown {
            cell: self.cell.to_owned(),
            candidate_id: goal.candidate_id.clone(),
            goal_id: id.clone(),
            message,
        };
        match self.journal.past(&id) {
            Past::Over(report) => return Ok((*report, Moved::Now)),
            Past::New => self.journal.send(&id)?,
            Past::Sent => match self.client.recover(&id, answer, result)? {
                Recovered::Report(report) => {
                    self.journal.conclude(&report)?;
                    return Ok((report, Moved::Now));
                }
                // Only a goal that the cell never took goes out again, under its own name.
                Recovered::NeverTaken => {}
                Recovered::Silent => {
                    let message = format!("no answer about it within {answer:.1?}");
                    return Err(unknown(message));
                }
            },
        }
        // A second cell of the name may have come: it would move too.
        self.client.capabilities(answer)?;
        let done = match self.client.execute(goal, answer, result)? {
            Executed::Over(report) => (report, Moved::Now),
            Executed::Known(report) => (report, Moved::Before),
            Executed::Unheard(message) => return Err(unknown(message)),
        };
        let (report, moved) = done;
        if let Some(rejection) = report
            .rejection
            .as_ref()
            .filter(|rejection| passes(rejection))
        {
            return Err(DispatchError::NotNow {
                cell: self.cell.to_owned(),
                candidate_id: goal.candidate_id.clone(),
                reason: rejection.reason.clone(),
            });
        }
        if report.outcome != executions::Outcome::Rejected {
            self.journal.conclude(&report)?;
        }
        Ok((report, moved))
    }
}

/// Whether a refusal says nothing about the motion: later it may be taken.
fn passes(rejection: &Rejection) -> bool {
    matches!(
        rejection.code,
        RejectionCode::Busy
            | RejectionCode::Stopped
            | RejectionCode::Expired
            | RejectionCode::Storage
    )
}

/// What a row says of the cell.
struct Cell<'a> {
    name: &'a str,
    simulated: bool,
    gap: &'a str,
}

impl Cell<'_> {
    /// The row of a motion that was sent.
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

    /// The row of a motion that was not sent.
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

/// Makes sure that a motion's name can be a file's.
fn check_name(candidate: &Candidate) -> Result<(), DispatchError> {
    let mut components = Path::new(&candidate.candidate_id).components();
    match (components.next(), components.next()) {
        (Some(Component::Normal(_)), None) => Ok(()),
        _ => Err(DispatchError::BadOption {
            key: "candidates",
            problem: format!(
                "`{}` cannot name a recording's file",
                candidate.candidate_id
            ),
        }),
    }
}

fn only<'a>(
    inputs: &'a Inputs,
    input: &'static str,
    cx: &Context,
) -> Result<&'a Artifact, DispatchError> {
    inputs
        .artifacts(input)
        .first()
        .ok_or_else(|| missing(cx, input))
}

fn missing(cx: &Context, what: &'static str) -> DispatchError {
    DispatchError::MissingInput {
        partition: cx.partition().to_owned(),
        what,
    }
}
