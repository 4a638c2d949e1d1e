//! The motions that are exported, from the artifacts that have them.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::{NodeName, UnitRef};
use formats::{BenchObject, Episode, EpisodeStep, FormatError, Joint, Unit};
use geometry::TriMesh;
use lake::{Lake, Run, table};
use robot::{JointKind, RobotModel};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    executions::{Execution, Executions},
    objects::Object,
    rollouts::{Rollout, Rollouts},
    trajectories::Trajectory,
};

use super::{recorded, rerun};
use crate::{
    arguments::MotionsArgs,
    command_line::Program,
    commands::{lookup, report::hand},
    outcome::CommandError,
};

/// Motions, and what of the artifact is not among them.
pub(super) struct GatheredMotions {
    /// The motions, in the order of the artifact's rows.
    pub(super) episodes: Vec<Episode>,
    /// The hand's name.
    pub(super) hand: String,
    /// Omissions, one fact each.
    pub(super) left_out: Vec<String>,
    /// The run that has them.
    run: Run,
}

/// Exported part of a rollout or an execution.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ExportedPart {
    /// Measured and commanded motions, of rollouts that were recorded.
    Recording,
    /// The candidate that was executed.
    Candidate,
}

/// Outcome of a candidate.
struct CandidateOutcome {
    candidate_id: String,
    outcome: String,
}

impl GatheredMotions {
    /// Gathers motions as they were measured, where the artifact has measured ones.
    pub(super) fn executed(program: &Program, args: &MotionsArgs) -> Result<Self, CommandError> {
        Self::of(program, args, ExportedPart::Recording)
    }

    /// Gathers motions as they were planned.
    pub(super) fn planned(program: &Program, args: &MotionsArgs) -> Result<Self, CommandError> {
        Self::of(program, args, ExportedPart::Candidate)
    }

    fn of(program: &Program, args: &MotionsArgs, part: ExportedPart) -> Result<Self, CommandError> {
        let lake = program.open_lake()?;
        let run = lookup::run(&lake, args.run.as_deref())?;
        let (node, units) = lookup::units(&run, &args.artifact)?;
        let units = chosen(&run, &units, args)?;
        let urdf = match &args.hand {
            Some(urdf) => urdf.clone(),
            None => rerun::hand_of(program, &run)?,
        };
        let (_, model) = hand(&urdf)?;
        let has_outcomes = [Rollouts::NAME, Executions::NAME].contains(&node.artifact.as_str());
        if args.outcome.is_some() && !has_outcomes {
            return Err(CommandError::usage(
                format!("`{}` has no outcomes", args.artifact),
                "leave out `--outcome`, or export rollouts or executions",
            ));
        }
        let mut gathered = Self {
            episodes: Vec::new(),
            hand: model.name().to_owned(),
            left_out: Vec::new(),
            run: run.clone(),
        };
        match node.artifact.as_str() {
            Candidates::NAME => gathered.candidates(&lake, &units, &model)?,
            Trajectory::NAME => gathered.trajectories(&lake, &units, &model)?,
            Rollouts::NAME | Executions::NAME => {
                gathered.executions(&lake, &run, &node, &units, &model, (part, args))?;
            }
            other => {
                return Err(CommandError::usage(
                    format!("`{other}` has no motions"),
                    "candidates, trajectories, rollouts and executions have motions",
                ));
            }
        }
        Ok(gathered)
    }

    fn candidates(
        &mut self,
        lake: &Lake,
        units: &[&UnitRef],
        model: &RobotModel,
    ) -> Result<(), CommandError> {
        let mut refused_n = 0;
        for unit in units {
            let Some(artifact) = lookup::artifact(lake, unit)? else {
                continue;
            };
            let draws = table::read_draws(&artifact)?;
            refused_n += draws.iter().filter(|draw| draw.refused.is_some()).count();
            let of_object: Candidates = table::read(&artifact)?;
            let joints = joints(&of_object.joints, model);
            for candidate in &of_object.candidates {
                self.episodes
                    .push(drawn(candidate, &of_object.object, &joints)?);
            }
        }
        if refused_n > 0 {
            self.left_out
                .push(format!("{refused_n} refused samples: they have no motion"));
        }
        Ok(())
    }

    fn trajectories(
        &mut self,
        lake: &Lake,
        units: &[&UnitRef],
        model: &RobotModel,
    ) -> Result<(), CommandError> {
        for unit in units {
            let Some(artifact) = lookup::artifact(lake, unit)? else {
                continue;
            };
            let trajectory: Trajectory = table::read(&artifact)?;
            let table_from_object = trajectory.rest.table_from_object();
            let steps = trajectory.motion.steps().iter();
            let steps = steps.map(|step| EpisodeStep {
                time_s: step.time_s,
                table_from_palm: table_from_object * step.frame_from_palm,
                table_from_object,
                q: step.q_rad.clone(),
                q_command: None,
            });
            let joints = joints(trajectory.motion.joints(), model);
            let episode = Episode::new(
                &trajectory.sequence,
                &trajectory.object,
                &joints,
                &steps.collect::<Vec<_>>(),
            );
            self.episodes
                .push(episode.map_err(CommandError::with_hint(FormatError::hint))?);
        }
        Ok(())
    }

    fn executions(
        &mut self,
        lake: &Lake,
        run: &Run,
        node: &NodeName,
        units: &[&UnitRef],
        model: &RobotModel,
        (part, args): (ExportedPart, &MotionsArgs),
    ) -> Result<(), CommandError> {
        let (mut others_n, mut without_n) = (0, 0);
        for unit in units {
            let Some(of_object) = lookup::artifact(lake, unit)? else {
                continue;
            };
            let mut ended: Vec<CandidateOutcome> = if node.artifact == *Rollouts::NAME {
                let rows: Rollouts = table::read(&of_object)?;
                rows.iter().map(CandidateOutcome::from).collect()
            } else {
                let rows: Executions = table::read(&of_object)?;
                rows.iter().map(CandidateOutcome::from).collect()
            };
            let n = ended.len();
            ended.retain(|one| {
                args.outcome
                    .as_ref()
                    .is_none_or(|only| *only == one.outcome)
            });
            others_n += n - ended.len();
            let planned = match part {
                ExportedPart::Candidate => candidates_of(lake, run, node, unit)?,
                ExportedPart::Recording => None,
            };
            for one in ended {
                let episode = match (part, &planned) {
                    (ExportedPart::Candidate, Some(planned)) => {
                        let mut all = planned.candidates.iter();
                        let found = all.find(|other| other.candidate_id == one.candidate_id);
                        let joints = joints(&planned.joints, model);
                        found
                            .map(|found| drawn(found, &planned.object, &joints))
                            .transpose()?
                    }
                    (ExportedPart::Candidate, None) => None,
                    (ExportedPart::Recording, _) => recorded::episode(
                        &of_object,
                        &one.candidate_id,
                        unit.partition.as_str(),
                        model,
                    )?,
                };
                match episode {
                    Some(episode) => self.episodes.push(episode.with_outcome(&one.outcome)),
                    None => without_n += 1,
                }
            }
        }
        if others_n > 0 {
            self.left_out
                .push(format!("{others_n} motions with other outcomes"));
        }
        if without_n > 0 {
            self.left_out.push(match part {
                ExportedPart::Recording if node.artifact == *Rollouts::NAME => format!(
                    "{without_n} motions without a recording: `recorded_per_object` of the screen records more"
                ),
                ExportedPart::Recording => format!("{without_n} motions without a recording: nothing moved"),
                ExportedPart::Candidate => format!("{without_n} motions whose candidates are not in run {}", run.number),
            });
        }
        Ok(())
    }

    /// Returns the shapes of the motions' objects, by name.
    pub(super) fn objects(
        &self,
        program: &Program,
    ) -> Result<BTreeMap<String, BenchObject>, CommandError> {
        let lake = program.open_lake()?;
        let names: BTreeSet<&str> = self.episodes.iter().map(Episode::object).collect();
        let mut objects = BTreeMap::new();
        for unit in &self.run.record.units {
            if unit.node.artifact != *Object::NAME || !names.contains(unit.partition.as_str()) {
                continue;
            }
            let Some(artifact) = lookup::artifact(&lake, unit)? else {
                continue;
            };
            let object: Object = table::read(&artifact)?;
            let vertices = object.vertices_m.iter().map(|&vertex| vertex.into());
            let shape = BenchObject {
                mass_kg: object.mass_kg,
                center_of_mass_m: object.center_of_mass_m,
                mesh: TriMesh {
                    vertices_m: vertices.collect(),
                    triangles: object.triangles,
                },
                parts_m: object.parts_m,
            };
            objects.insert(object.name, shape);
        }
        Ok(objects)
    }
}

/// The units of the partitions that are asked for.
fn chosen<'a>(
    run: &Run,
    units: &[&'a UnitRef],
    args: &MotionsArgs,
) -> Result<Vec<&'a UnitRef>, CommandError> {
    if args.partitions.is_empty() {
        return Ok(units.to_vec());
    }
    let named = args.partitions.iter();
    named
        .map(|name| lookup::unit(units, run.number, &args.artifact, name))
        .collect()
}

/// The candidates that a stage executed for an object, if the run has them.
fn candidates_of(
    lake: &Lake,
    run: &Run,
    node: &NodeName,
    unit: &UnitRef,
) -> Result<Option<Candidates>, CommandError> {
    let stage = run.record.stages.get(&node.stage);
    let read = stage.and_then(|stage| {
        let mut inputs = stage.inputs.iter();
        inputs.find(|(name, _)| name.as_str() == Candidates::NAME)
    });
    let Some((_, from)) = read else {
        return Ok(None);
    };
    let mut units = run.record.units.iter();
    let found = units.find(|other| other.node == *from && other.partition == unit.partition);
    let artifact = found
        .map(|unit| lookup::artifact(lake, unit))
        .transpose()?
        .flatten();
    Ok(artifact
        .map(|artifact| table::read(&artifact))
        .transpose()?)
}

/// A candidate's motion about its object, which lies still.
fn drawn(candidate: &Candidate, object: &str, joints: &[Joint]) -> Result<Episode, CommandError> {
    let steps = candidate.motion.steps().iter();
    let steps = steps.map(|step| EpisodeStep {
        time_s: step.time_s,
        table_from_palm: candidate.table_from_object * step.frame_from_palm,
        table_from_object: candidate.table_from_object,
        q: step.q_rad.clone(),
        q_command: None,
    });
    Episode::new(
        &candidate.candidate_id,
        object,
        joints,
        &steps.collect::<Vec<_>>(),
    )
    .map_err(CommandError::with_hint(FormatError::hint))
}

/// Joints by their names, with the units that the hand gives them.
pub(super) fn joints(names: &[String], model: &RobotModel) -> Vec<Joint> {
    let unit = |name: &str| {
        let known = model.joints().iter().find(|joint| joint.name == name);
        match known.map(|joint| joint.kind) {
            Some(JointKind::Prismatic) => Unit::Meter,
            Some(JointKind::Revolute | JointKind::Continuous) | None => Unit::Radian,
        }
    };
    let joint = |name: &String| Joint {
        name: name.clone(),
        unit: unit(name),
    };
    names.iter().map(joint).collect()
}

impl From<&Rollout> for CandidateOutcome {
    fn from(rollout: &Rollout) -> Self {
        Self {
            candidate_id: rollout.candidate_id.clone(),
            outcome: rollout.verdict.as_str().to_owned(),
        }
    }
}

impl From<&Execution> for CandidateOutcome {
    fn from(execution: &Execution) -> Self {
        Self {
            candidate_id: execution.candidate_id.clone(),
            outcome: execution.outcome.as_str().to_owned(),
        }
    }
}
