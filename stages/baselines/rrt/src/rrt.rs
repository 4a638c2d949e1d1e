//! The stage: one unit per object.

use std::{path::PathBuf, sync::Arc};

use dataflow::{
    BoxedDiagnostic, Context, Line, Max, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum,
    Unit,
};
use geometry::DistanceField;
use hand_files::HandFiles;
use lake::{ReadArtifact, SiblingTable, WriteArtifact};
use motion::Motion;
use posture::{Environment, Hand};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use robot_meshes::HandMismatch;
use rrt_connect::{RrtOutcome, RrtPlan, RrtPlanner};
use schemas::{
    Table,
    candidates::{Candidate, Candidates, Origin},
    distance_fields::{self, FieldInfo},
    draws::{Draw, Draws},
};
use spatial::{Object, RestingPose};

use crate::RrtConfig;

/// Plans a way around object and table to the grasp of each motion, by RRT-Connect.
pub struct Rrt;

/// Generator named in the candidates.
const GENERATOR: &str = "rrt";

dataflow::metrics! {
    /// Metrics of an object's planned motions.
    pub struct RrtMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of those whose start is free, and a pregrasp of whose grasp.
        reachable: Sum,
        /// Number of those for which a path was found.
        paths: Sum,
        /// Configurations checked against object and table, for all candidates.
        checks: Sum,
        /// Those of them that were checked for the candidates with a path.
        checks_of_paths: Sum,
        /// Nodes of all trees.
        nodes: Sum,
        /// Processor time of the planning in seconds.
        cpu_s: Sum,
        /// Greatest depth of a step on a path in object or table, in meters.
        path_depth_m: Max,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions, its distances and the hand.
    pub struct RrtInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE], "to plan ways to";
        /// The distances from the object.
        own field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes),
            or "object has no distance field";
    }
    files {
        /// The hand's URDF.
        urdf: PathBuf = hand_files::urdf;
        /// The hand.
        hand: Hand = hand_files::hand;
    }
}

impl Stage for Rrt {
    type Config = RrtConfig;

    const KIND: &'static str = "rrt";
    const ABOUT: &'static str = "Plans a way to the grasp of each motion by RRT-Connect";
    const INPUTS: &'static [&'static str] = RrtInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];

    /// Checks the hand and its table.
    fn prepare(config: &RrtConfig) -> Result<(), BoxedDiagnostic> {
        hand_files::load(&config.hand, &config.hand_table)?;
        Ok(())
    }
}

impl Output for Rrt {
    type Stage = Self;
    type Metrics = RrtMetrics;
    type Inputs<'a> = RrtInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::All;
    const LINE: Option<Line<RrtMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [n, reachable, paths] = [metrics.candidates, metrics.reachable, metrics.paths];
        let checks = metrics.checks / n.max(1.0);
        format!("{n} grasps, {reachable} reachable → {paths} paths, {checks:.0} checks each")
    });

    fn units(config: &RrtConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = RrtInputs::units(scope, &[])?;
        Ok(HandFiles::of(&config.hand, &config.hand_table)?.added_to_each(units))
    }

    fn make(
        config: &RrtConfig,
        inputs: RrtInputs,
        cx: &Context,
    ) -> Result<Outcome<RrtMetrics>, BoxedDiagnostic> {
        let RrtInputs {
            candidates: given,
            field,
            urdf,
            hand,
        } = inputs;
        let field = Arc::new(field);
        let joints = hand.model.joint_names();
        let of_object = (given.object.as_str(), &given.joints[..]);
        HandMismatch::check(Self::KIND, of_object, (&urdf, &hand.model))?;
        let planned = given.candidates.par_iter().enumerate();
        let search = || RrtPlanner::new(&hand, config.planner());
        let planned = planned.map_init(search, |search, (idx, candidate)| {
            let mut rng = ChaCha8Rng::seed_from_u64(cx.seed());
            rng.set_stream(idx as u64);
            let rest = RestingPose::of(&candidate.table_from_object);
            let environment = Environment::new(Arc::clone(&field), rest);
            cpu_time::measured(|| search.plan(&environment, &candidate.motion, &mut rng))
        });
        let planned: Vec<_> = planned.collect();
        let mut metrics = RrtMetrics::none();
        let mut candidates = Vec::with_capacity(planned.len());
        let mut draws = Draws::new();
        for (candidate, (plan, cpu_s)) in given.candidates.iter().zip(planned) {
            match plan {
                Ok(plan) => {
                    metrics.add(&plan, cpu_s);
                    let planned = candidate_of(candidate, plan);
                    draws.push(Draw::kept(&planned));
                    candidates.push(planned);
                }
                Err(err) => {
                    let refused = remade(candidate, candidate.motion.clone());
                    draws.push(Draw::without_motion(&refused, err.to_string()));
                }
            }
        }
        cx.write(&Candidates {
            object: given.object,
            joints: joints.as_slice().into(),
            candidates,
        })?;
        cx.write(&draws)?;
        Ok(Outcome::Made(metrics))
    }
}

/// Returns the candidate of a plan to the grasp of another one.
fn candidate_of(given: &Candidate, plan: RrtPlan) -> Candidate {
    // Both ends are within the limits, and so is what lies between them.
    Candidate {
        depth_m: Some(plan.depth_m),
        ..remade(given, plan.motion)
    }
}

/// Returns the candidate of this motion to the grasp of another one.
fn remade(given: &Candidate, motion: Motion<Object>) -> Candidate {
    given.remade("rrt", GENERATOR, Origin::Planner, motion)
}

impl RrtMetrics {
    /// Returns the metrics of no motion.
    fn none() -> Self {
        Self {
            candidates: 0.0,
            reachable: 0.0,
            paths: 0.0,
            checks: 0.0,
            checks_of_paths: 0.0,
            nodes: 0.0,
            cpu_s: 0.0,
            path_depth_m: 0.0,
        }
    }

    /// Adds a motion and the processor time of its planning.
    fn add(&mut self, plan: &RrtPlan, cpu_s: f64) {
        let checks = plan.checks_n as f64;
        self.candidates += 1.0;
        self.checks += checks;
        self.nodes += plan.nodes_n as f64;
        self.cpu_s += cpu_s;
        match plan.outcome {
            RrtOutcome::Found => {
                self.reachable += 1.0;
                self.paths += 1.0;
                self.checks_of_paths += checks;
                self.path_depth_m = self.path_depth_m.max(plan.depth_m);
            }
            RrtOutcome::NoPath => self.reachable += 1.0,
            RrtOutcome::Unreachable => {}
        }
    }
}
