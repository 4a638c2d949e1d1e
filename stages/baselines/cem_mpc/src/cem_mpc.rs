//! The stage: one unit per object.

use std::path::{Path, PathBuf};

use cem_mpc::{ControlError, ControlledMotion, Controller, Fingertips, Scenes};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Outputs, Scope,
    Stage, Sum, Unit,
};
use hand_files::HandFiles;
use lake::{ReadInputs, SiblingTable, WriteArtifact};
use motion::Motion;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use robot::RobotModel;
use robot_meshes::HandMismatch;
use schemas::{
    Table,
    candidates::{Candidate, Candidates, Origin},
    draws::{Draw, Draws},
    objects::Object,
};
use simulation::{ObjectShape, SimulationError, check_hand};
use spatial::Object as InObject;

use crate::{CemMpcConfig, CemMpcError};

/// Moves the hand to the grasp of each motion by model predictive control with the cross-entropy method.
pub struct CemMpc;

/// Generator named in the candidates.
const GENERATOR: &str = "cem_mpc";

dataflow::metrics! {
    /// Metrics of an object's controlled motions.
    pub struct CemMpcMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of those whose fingertips came to the grasp's.
        reached: Sum,
        /// Control steps simulated by the searches, for all candidates.
        searched_steps: Sum,
        /// Control steps executed.
        executed_steps: Sum,
        /// Mean cost of a control step at the start.
        first_cost: Mean,
        /// Mean cost of a control step at the end.
        last_cost: Mean,
        /// Mean distance of the fingertips from the grasp's at the start, in meters.
        first_tip_error_m: Mean,
        /// The same at the end.
        last_tip_error_m: Mean,
        /// Mean displacement of the object, in meters.
        object_moved_m: Mean,
        /// Processor time of searches and execution in seconds.
        cpu_s: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions, the object and the hand.
    pub struct CemMpcInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE], "to control";
        /// The object.
        own object: Object, or "object missing";
    }
    files {
        /// The hand's URDF.
        urdf: PathBuf = hand_files::urdf;
        /// The hand and the links of its fingertips.
        hand: (RobotModel, Fingertips) = |inputs: &Inputs| {
            load_hand(&hand_files::urdf(inputs)?, &inputs.source("hand_table")?.path)
        };
    }
}

impl Stage for CemMpc {
    type Config = CemMpcConfig;

    const KIND: &'static str = "cem_mpc";
    const ABOUT: &'static str = "Controls the hand to the grasp of each motion, in simulation";
    const INPUTS: &'static [&'static str] = CemMpcInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];

    /// Checks the hand and its table, and that the hand can be simulated as the options say.
    fn prepare(config: &CemMpcConfig) -> Result<(), BoxedDiagnostic> {
        let config = config.resolved();
        let (hand, _) = load_hand(&config.hand, &config.hand_table)?;
        check_hand(&config.scene, &hand).map_err(|source| CemMpcError::Simulation {
            path: config.hand.clone(),
            source,
        })?;
        Ok(())
    }
}

impl Output for CemMpc {
    type Stage = Self;
    type Metrics = CemMpcMetrics;
    type Inputs<'a> = CemMpcInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    /// `objects` only chooses units.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects"]);
    const LINE: Option<Line<CemMpcMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [n, reached] = [metrics.candidates, metrics.reached];
        let steps = (metrics.searched_steps + metrics.executed_steps) / n.max(1.0);
        let errors_mm =
            [metrics.first_tip_error_m, metrics.last_tip_error_m].map(|error_m| 1000.0 * error_m);
        let [first, last] = errors_mm;
        format!(
            "{n} motions, {reached} at their grasps, tips off by {first:.0} → {last:.0} mm, \
             {steps:.0} steps each"
        )
    });

    fn units(config: &CemMpcConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = CemMpcInputs::units(scope, &config.objects)?;
        Ok(HandFiles::of(&config.hand, &config.hand_table)?.added_to_each(units))
    }

    fn make(
        config: &CemMpcConfig,
        inputs: CemMpcInputs,
        cx: &Context,
    ) -> Result<Outcome<CemMpcMetrics>, BoxedDiagnostic> {
        let config = config.resolved();
        let CemMpcInputs {
            candidates: mut given,
            object,
            urdf,
            hand: (hand, tips),
        } = inputs;
        given.candidates.truncate(config.per_object);
        let joints = hand.joint_names();
        let of_object = (given.object.as_str(), &given.joints[..]);
        HandMismatch::check(Self::KIND, of_object, (&urdf, &hand))?;
        let shape = ObjectShape::from_artifact(&object);
        let poses = given.candidates.iter();
        let poses = poses.map(|candidate| candidate.table_from_object);
        let scenes = match Scenes::new(&config.scene, &hand, &shape, poses) {
            Ok(scenes) => scenes,
            Err(source) => return skip_or_fail(&urdf, source),
        };
        let mpc = Controller::new(&hand, &tips, config.control());
        let controlled = given.candidates.par_iter().enumerate();
        let controlled = controlled.map(|(idx, candidate)| {
            let mut rng = ChaCha8Rng::seed_from_u64(cx.seed());
            rng.set_stream(idx as u64);
            cpu_time::measured(|| {
                let scene = scenes.at(&candidate.table_from_object)?;
                mpc.control(scene, &candidate.motion, &mut rng)
            })
        });
        let controlled: Vec<_> = controlled.collect();
        let mut made: Vec<ControlledMotion> = Vec::with_capacity(controlled.len());
        let mut candidates: Vec<Candidate> = Vec::with_capacity(controlled.len());
        let mut draws = Draws::new();
        let mut all_s = 0.0;
        for (candidate, (controlled, cpu_s)) in given.candidates.iter().zip(controlled) {
            all_s += cpu_s;
            match controlled {
                Ok(controlled) => {
                    // Commands are within the limits.
                    let candidate = remade(candidate, controlled.motion.clone());
                    draws.push(Draw::kept(&candidate));
                    candidates.push(candidate);
                    made.push(controlled);
                }
                Err(ControlError::Simulation(source)) => return skip_or_fail(&urdf, source),
                Err(ControlError::Motion(err)) => {
                    let refused = remade(candidate, candidate.motion.clone());
                    draws.push(Draw::without_motion(&refused, err.to_string()));
                }
            }
        }
        let metrics = CemMpcMetrics::of(&made, all_s);
        cx.write(&Candidates {
            object: given.object,
            joints: joints.as_slice().into(),
            candidates,
        })?;
        cx.write(&draws)?;
        Ok(Outcome::Made(metrics))
    }
}

/// Returns the candidate of this motion to the grasp of another one.
fn remade(given: &Candidate, motion: Motion<InObject>) -> Candidate {
    given.remade("cem", GENERATOR, Origin::Planner, motion)
}

/// Returns the outcome where the object is at fault; fails where the hand or the options are, and so every unit will.
fn skip_or_fail(
    urdf: &Path,
    source: SimulationError,
) -> Result<Outcome<CemMpcMetrics>, BoxedDiagnostic> {
    if source.is_of_object() {
        return Ok(Outcome::skipped(source.to_string()));
    }
    let path = urdf.to_owned();
    Err(CemMpcError::Simulation { path, source }.into())
}

/// Reads a hand and its table, and finds the links of its fingertips.
fn load_hand(
    urdf_path: &Path,
    table_path: &Path,
) -> Result<(RobotModel, Fingertips), BoxedDiagnostic> {
    let model = robot_meshes::load(urdf_path)?.model;
    let table = hand_files::load_table(table_path)?;
    let tips = Fingertips::new(&model, &table).map_err(|source| CemMpcError::Hand {
        path: urdf_path.to_owned(),
        source,
    })?;
    if tips.is_empty() {
        let path = table_path.to_owned();
        return Err(CemMpcError::NoFingertip { path }.into());
    }
    Ok((model, tips))
}

impl CemMpcMetrics {
    fn of(controlled: &[ControlledMotion], cpu_s: f64) -> Self {
        let n = controlled.len() as f64;
        let sum = |of: fn(&ControlledMotion) -> f64| controlled.iter().map(of).sum::<f64>();
        let mean = |of: fn(&ControlledMotion) -> f64| sum(of) / n.max(1.0);
        Self {
            candidates: n,
            reached: sum(|one| f64::from(u8::from(one.reached))),
            searched_steps: sum(|one| one.searched_n as f64),
            executed_steps: sum(|one| one.executed_n as f64),
            first_cost: mean(|one| one.first.cost),
            last_cost: mean(|one| one.last.cost),
            first_tip_error_m: mean(|one| one.first.tip_error_m),
            last_tip_error_m: mean(|one| one.last.tip_error_m),
            object_moved_m: mean(|one| one.last.object_moved_m),
            cpu_s,
        }
    }
}
