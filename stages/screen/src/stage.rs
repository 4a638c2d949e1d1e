//! The stage: the rollouts of one object's candidates.

use std::{collections::BTreeMap, fs, path::Path};

use dataflow::{
    Code, Context, Form, Input, Inputs, Labels, Made, OptionFault, Outcome, Output, Scope,
    SourceFile, Stage, Unit,
};
use lake::{ReadInputs, WriteArtifact};
use robot::{JointOrder, RobotModel};
use schemas::{
    Table,
    candidates::Candidates,
    objects::Object,
    rollouts::{Rollout, Rollouts, Verdict},
};
use simulation::{Flexion, Record, SimulationError, check_hand};

use crate::{
    ScreenConfig, ScreenError,
    recording::{self, record},
    verdicts::Screening,
};

/// Judges candidate motions in physics.
pub enum Screen {}

/// The robot counts as recordings show it.
const SHOWN_ROBOT: Form = Form {
    name: "shown robot",
    of: robot::shown_form,
};

/// The artifact of what became of each candidate.
pub const ROLLOUTS: &str = "rollouts";

impl Stage for Screen {
    type Config = ScreenConfig;
    type Error = ScreenError;

    const KIND: &'static str = "screen";
    const ABOUT: &'static str = "Judges candidate motions in physics";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "candidates",
            artifact: "candidates",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: ROLLOUTS,
        schema: Rollouts::VERSION,
        partition: "object",
        parallel: true,
    }];

    fn check(config: &ScreenConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks that the hand can be read, and be simulated as the options say.
    fn prepare(config: &ScreenConfig) -> Result<(), ScreenError> {
        let (_, hand) = load_hand(&config.hand)?;
        check_hand(&config.scene, &hand)
            .and_then(|()| Flexion::new(&config.protocol, &hand).map(drop))
            .map_err(|source| ScreenError::Options {
                path: config.hand.clone(),
                source,
            })
    }

    fn units(
        config: &ScreenConfig,
        _output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, ScreenError> {
        let candidates = scope.partitions("candidates");
        if candidates.is_empty() {
            return Err(ScreenError::NoCandidates);
        }
        let objects = scope.partitions("objects");
        let meshes = robot_meshes::sources(&config.hand)?;
        Ok(candidates
            .iter()
            .map(|partition| {
                // An object that is missing is planned without, and skipped.
                let object = objects.iter().find(|object| object.key == partition.key);
                let unit = Unit::new(&partition.key)
                    .reading("candidates", [&partition.key])
                    .reading("objects", object.map(|object| &object.key))
                    .with_file_of_form(SourceFile::named("hand", &config.hand), SHOWN_ROBOT);
                meshes.iter().cloned().fold(unit, Unit::with_file)
            })
            .collect())
    }

    fn foretell(
        _config: &ScreenConfig,
        _output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        let object = unit.partition.clone();
        Some(Labels::from([("object".to_owned(), object)]))
    }

    fn run(config: &ScreenConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, ScreenError> {
        let urdf = inputs.source(0, "URDF of a hand")?;
        let (xml, model) = load_hand(&urdf.path)?;
        let candidates: Candidates = inputs.one()?;
        let Some(object) = inputs.optional::<Object>()? else {
            return Ok(skipped("it is not among the objects"));
        };
        JointOrder::new(&candidates.joints, &model.joint_names()).map_err(|source| {
            ScreenError::AnotherHand {
                partition: cx.partition().to_owned(),
                path: urdf.path.clone(),
                source,
            }
        })?;

        let failed = |candidate: Option<String>, source: SimulationError| {
            unusable(&source, candidate.as_deref()).ok_or_else(|| ScreenError::Simulation {
                partition: cx.partition().to_owned(),
                path: urdf.path.clone(),
                source,
            })
        };
        let screening = match Screening::new(config, &model, &object, &candidates, cx.seed()) {
            Ok(screening) => screening,
            Err(err) => return failed(None, err),
        };
        let rollouts = match screening.judge(|share| cx.progress(share, "in physics")) {
            Ok(rollouts) => rollouts,
            Err((candidate, err)) => return failed(Some(candidate), err),
        };

        cx.write(&rollouts)?;
        let stage = recording::Stage {
            urdf: &xml,
            model: &model,
            object: &object,
        };
        let held = |idx: &usize| rollouts[*idx].verdict == Verdict::Held;
        for idx in (0..rollouts.len())
            .filter(held)
            .take(config.recorded_per_object)
        {
            // Equal arguments give an equal rollout: it is run again, now with its trace.
            match screening.rollout(idx, Record::Trace) {
                Ok((candidate, rollout)) => {
                    record(&stage, &candidate.candidate_id, &rollout, cx.folder())?;
                }
                Err((candidate, err)) => return failed(Some(candidate), err),
            }
        }
        Ok(Outcome::Made(Made {
            labels: BTreeMap::from([("object".to_owned(), object.name)]),
            metrics: metrics(&rollouts),
        }))
    }
}

fn metrics(rollouts: &[Rollout]) -> BTreeMap<String, f64> {
    let count = |verdict: Verdict| rollouts.iter().filter(|r| r.verdict == verdict).count() as f64;
    let steps: f64 = rollouts.iter().map(|r| f64::from(r.cost_n)).sum();
    let mut metrics: BTreeMap<String, f64> = [
        ("candidates_n", rollouts.len() as f64),
        ("accepted_n", count(Verdict::Held)),
        ("control_steps_n", steps),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into();
    for verdict in Verdict::ALL {
        metrics.insert(format!("{}_n", verdict.as_str()), count(verdict));
    }
    metrics
}

fn skipped(reason: impl Into<String>) -> Outcome {
    Outcome::Skipped {
        reason: reason.into(),
    }
}

/// Returns the outcome where the object or one of its candidates is at fault; nothing where the
/// hand or the options are, and so every unit will fail.
fn unusable(err: &SimulationError, candidate: Option<&str>) -> Option<Outcome> {
    match err {
        SimulationError::Massless { .. }
        | SimulationError::ObjectInertia { .. }
        | SimulationError::FlatPart { .. }
        | SimulationError::NoParts
        | SimulationError::Unsettled => Some(skipped(err.to_string())),
        SimulationError::Motion(_) => Some(skipped(match candidate {
            Some(candidate) => format!("candidate `{candidate}`: {err}"),
            None => err.to_string(),
        })),
        _ => None,
    }
}

/// Reads the hand's URDF and meshes: its plain text and what it says.
fn load_hand(path: &Path) -> Result<(String, RobotModel), ScreenError> {
    let xml = fs::read_to_string(path).map_err(|source| ScreenError::ReadHand {
        path: path.to_owned(),
        source,
    })?;
    let model = RobotModel::from_urdf(&xml).map_err(|source| ScreenError::Hand {
        path: path.to_owned(),
        source,
    })?;
    let model = robot_meshes::with_mesh_shapes(model, path)?;
    Ok((robot::plain_urdf(&xml), model))
}
