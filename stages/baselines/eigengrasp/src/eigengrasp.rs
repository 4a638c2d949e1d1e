//! The stage: one unit per object.

use approach::{ApproachError, Attempts, Grasp, HandBody, Reach, Start, grasps, virtual_contacts};
use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum,
    Unit,
};
use grasp_inputs::GraspInputs;
use hand_files::HandFiles;
use lake::WriteArtifact;
use nalgebra::Point3;
use posture::Environment;
use rand_chacha::ChaCha8Rng;
use robot::{RobotModel, SurfacePoint};
use schemas::{Table, candidates::Candidates, objects::Object};
use spatial::RestingPose;

use crate::{
    EigengraspConfig,
    annealing_run::{FinishedGrasp, Run, RunResult},
    basis::Basis,
};

/// Anneals grasps in the space of eigengrasps, and reaches for them.
pub struct Eigengrasp;

/// Generator named in the candidates.
const GENERATOR: &str = "eigengrasp";
/// Stream of random numbers of the starts, which no run's number reaches.
const STARTS_STREAM: u64 = u64::MAX;
/// Shortest length by which torques are divided, in meters.
const MIN_LENGTH_M: f64 = 0.01;

dataflow::metrics! {
    /// Metrics of an object's grasps.
    pub struct EigengraspMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of them in force closure.
        force_closure: Sum,
        /// Steps of annealing.
        steps: Sum,
        /// States checked for collisions.
        collision_checks: Sum,
        /// Contact energies evaluated.
        evaluations: Sum,
        /// Mean contact energy of the candidates before they were finished, in millimeters.
        energy_mm: Mean,
        /// Mean wrench that the candidates withstand in the worst direction, relative to their normal forces.
        epsilon: Mean,
        /// Share of the retargeted grasps' variance along the eigengrasps.
        explained_variance: Mean,
        /// Processor time of all runs, in seconds.
        cpu_s: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object, its distances, every demonstration and the hand.
    pub struct EigengraspInputs {
        /// The object, its distances and the demonstrations.
        with given: GraspInputs;
    }
    files {
        /// The hand's model.
        model: RobotModel = hand_files::model;
    }
}

impl Stage for Eigengrasp {
    type Config = EigengraspConfig;

    const KIND: &'static str = "eigengrasp";
    const ABOUT: &'static str = "Anneals grasps in a space of eigengrasps, and reaches for them";
    const INPUTS: &'static [&'static str] = EigengraspInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self];

    /// Checks the hand.
    fn prepare(config: &EigengraspConfig) -> Result<(), BoxedDiagnostic> {
        let model = robot_meshes::load(&config.hand)?.model;
        let middle = model.mid_range();
        HandBody::new(model, &config.flexion_joints, middle)?;
        Ok(())
    }
}

impl Output for Eigengrasp {
    type Stage = Self;
    type Metrics = EigengraspMetrics;
    type Inputs<'a> = EigengraspInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    /// `objects` only chooses units.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects"]);
    const LINE: Option<Line<EigengraspMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [n, closed] = [metrics.candidates, metrics.force_closure];
        let percent = 100.0 * metrics.explained_variance;
        format!(
            "{} objects → {n} grasps, {closed} in force closure; {percent:.0} % of variance explained",
            summary.n_made
        )
    });

    fn units(config: &EigengraspConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = EigengraspInputs::units(scope, &config.objects)?;
        Ok(HandFiles::without_table(&config.hand)?.added_to_each(units))
    }

    fn make(
        config: &EigengraspConfig,
        inputs: EigengraspInputs,
        cx: &Context,
    ) -> Result<Outcome<EigengraspMetrics>, BoxedDiagnostic> {
        let EigengraspInputs {
            given:
                GraspInputs {
                    object,
                    field,
                    trajectories,
                },
            model,
        } = inputs;
        let joints = model.joint_names();
        let starts = Start::of(&trajectories, &joints)?;
        let basis = Basis::of(&grasps(&trajectories, &joints)?, config.eigengrasps)?;
        let body = HandBody::new(model, &config.flexion_joints, basis.mean.clone())?;
        let annealer = Annealer {
            config,
            contacts: virtual_contacts(&body),
            body: &body,
            basis: &basis,
            attempts: Attempts::new(&object, field, config.approach.rests, cx.seed()),
            object: &object,
        };
        let (ranked, spent) = annealer.ranked()?;
        if ranked.is_empty() {
            return Ok(Outcome::skipped(
                "no state of any run is free of collisions",
            ));
        }
        let mut rng = annealer.attempts.random(STARTS_STREAM);
        let reach = Reach::new(&body, &config.approach, GENERATOR, &object.name);
        let candidates = ranked.iter().enumerate().map(|(number, (rest, finished))| {
            let grasp = Grasp {
                hand: finished.hand.clone(),
                depth_m: finished.depth_m,
                residual_m2: None,
            };
            let environment = annealer.attempts.environment(*rest);
            let start = Start::draw(&starts, &mut rng);
            reach.candidate(number, &environment, &grasp, start)
        });
        let candidates = candidates.collect::<Result<_, _>>()?;
        cx.write(&reach.table(candidates))?;
        Ok(Outcome::Made(metrics(&ranked, &spent, &basis)))
    }
}

/// Anneals the grasps of one object.
struct Annealer<'a> {
    config: &'a EigengraspConfig,
    body: &'a HandBody,
    basis: &'a Basis,
    contacts: Vec<SurfacePoint>,
    attempts: Attempts,
    object: &'a Object,
}

impl Annealer<'_> {
    /// Returns the best finished grasps of all runs, each with the object's resting pose, and the work spent.
    fn ranked(&self) -> Result<(Vec<(RestingPose, FinishedGrasp)>, RunResult), ApproachError> {
        let runs = self
            .attempts
            .results(self.config.runs, |_, environment, rng| {
                Ok::<_, ApproachError>((environment.rest(), self.run(environment, rng)?))
            })?;
        let mut spent = RunResult::default();
        let mut ranked = Vec::new();
        for ((rest, made), cpu_s) in runs {
            spent.steps += made.steps;
            spent.checks += made.checks;
            spent.evaluations += made.evaluations;
            spent.cpu_s += cpu_s;
            ranked.extend(made.grasps.into_iter().map(|grasp| (rest, grasp)));
        }
        // The sort is stable: of equals the one of the lower energy and the earlier run is first.
        ranked.sort_by(|(_, a), (_, b)| {
            let by_quality = b.epsilon.total_cmp(&a.epsilon);
            by_quality.then(a.energy_mm.total_cmp(&b.energy_mm))
        });
        ranked.truncate(self.config.per_object);
        Ok((ranked, spent))
    }

    /// Makes a run about the object as it lies.
    fn run(
        &self,
        environment: &Environment,
        rng: &mut ChaCha8Rng,
    ) -> Result<RunResult, ApproachError> {
        let center_in_object = Point3::from(self.object.center_of_mass_m);
        let run = Run {
            config: self.config,
            body: self.body,
            basis: self.basis,
            contacts: &self.contacts,
            environment,
            center_in_object,
            length_m: radius_m(self.object, &center_in_object),
        };
        run.grasps(rng)
    }
}

/// Returns the distance of an object's farthest point from its center of mass, in meters, `GraspIt`'s length for
/// torques.
fn radius_m(object: &Object, center: &Point3<f64>) -> f64 {
    let vertices = object.vertices_m.iter();
    let far = vertices.map(|&vertex| (Point3::from(vertex) - center).norm());
    far.fold(MIN_LENGTH_M, f64::max)
}

fn metrics(
    ranked: &[(RestingPose, FinishedGrasp)],
    spent: &RunResult,
    basis: &Basis,
) -> EigengraspMetrics {
    let n = ranked.len() as f64;
    let mean =
        |of: fn(&FinishedGrasp) -> f64| ranked.iter().map(|(_, one)| of(one)).sum::<f64>() / n;
    let closed = ranked.iter().filter(|(_, grasp)| grasp.epsilon > 0.0);
    EigengraspMetrics {
        candidates: n,
        force_closure: closed.count() as f64,
        cpu_s: spent.cpu_s,
        steps: spent.steps as f64,
        collision_checks: spent.checks as f64,
        evaluations: spent.evaluations as f64,
        energy_mm: mean(|grasp| grasp.energy_mm),
        epsilon: mean(|grasp| grasp.epsilon),
        explained_variance: basis.explained,
    }
}

#[cfg(test)]
mod tests {
    use schemas::candidates::Origin;

    use super::*;
    use crate::fixture;

    /// Runs the stage on the box; returns what it measured and wrote.
    fn run(
        config: &EigengraspConfig,
        seed: u64,
        with_field: bool,
    ) -> (Outcome<EigengraspMetrics>, Option<Candidates>) {
        let trajectories = fixture::trajectories();
        fixture::BOX.candidates::<Eigengrasp>(config, &trajectories, with_field, seed)
    }

    fn small() -> EigengraspConfig {
        EigengraspConfig {
            runs: 2,
            steps: 400,
            kept: 3,
            per_object: 4,
            ..fixture::config()
        }
    }

    #[test]
    fn the_best_grasps_of_all_runs_are_motions_in_their_order() {
        let (outcome, made) = run(&small(), 3, true);
        let Outcome::Made(metrics) = outcome else {
            panic!("not made");
        };
        let made = made.unwrap();
        assert_eq!(metrics.candidates, made.candidates.len() as f64);
        assert!((1.0..=4.0).contains(&metrics.candidates));
        assert_eq!(metrics.steps, 800.0);
        assert!(metrics.collision_checks >= metrics.evaluations);
        // Two directions explain what differs in two directions.
        assert!((metrics.explained_variance - 1.0).abs() < 1e-9);
        for (number, one) in made.candidates.iter().enumerate() {
            assert_eq!(one.candidate_id, format!("box-{number:05}"));
            assert_eq!(
                (one.generator.as_str(), one.source.origin),
                ("eigengrasp", Origin::Grasp)
            );
            assert_eq!(one.motion.steps().len(), 40);
        }
    }

    #[test]
    fn grasps_are_those_of_the_seed_on_any_number_of_threads() {
        grasp_fixture::check_seed(|seed| run(&small(), seed, true).1);
    }

    #[test]
    fn an_object_without_distances_is_skipped_with_the_reason() {
        grasp_fixture::check_skipped_without_field(run(&small(), 3, false));
    }

    #[test]
    fn objects_are_chosen_by_name() {
        grasp_fixture::check_chosen_objects(|objects, scope| {
            Eigengrasp::units(&EigengraspConfig { objects, ..small() }, scope)
        });
    }

    #[test]
    fn options_out_of_bounds_are_named() {
        assert!(Eigengrasp::check(&small()).is_empty());
        let mut bad = small();
        bad.per_object = 0;
        bad.friction = f64::NAN;
        bad.flexion_joints = Vec::new();
        bad.approach.steps = 1;
        let keys: Vec<String> = Eigengrasp::check(&bad)
            .into_iter()
            .map(|fault| fault.key)
            .collect();
        assert_eq!(
            keys,
            ["per_object", "friction", "approach.steps", "flexion_joints"]
        );
    }
}
