//! The stage: one unit per object.

use approach::{Attempts, ContactModel, Grasp, HandBody, Reach, Start};
use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum,
    Unit,
};
use grasp_inputs::GraspInputs;
use hand_files::HandFiles;
use lake::WriteArtifact;
use nalgebra::Point3;
use posture::{Environment, Hand};
use rand_chacha::ChaCha8Rng;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    objects::Object,
};

use crate::{
    ForceClosureConfig, ForceClosureError,
    contacts::Tip,
    search::{FoundGrasp, Search},
};

/// Searches fingertip grasps with the greatest min-weight metric, and reaches for them.
pub struct ForceClosure;

/// Generators named in the candidates: searched grasps, and random palms.
const GENERATORS: [&str; 2] = ["force_closure", "random_palm"];
/// Fewest fingertips that can hold an object in force closure.
const FEWEST_TIPS: usize = 3;
/// Shortest length by which torques are divided, in meters.
const MIN_LENGTH_M: f64 = 0.01;

dataflow::metrics! {
    /// Metrics of an object's grasps.
    pub struct ForceClosureMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of them that are feasible: every tip on the surface, no link too deep, the metric large enough.
        feasible: Sum,
        /// Random palms drawn.
        palms: Sum,
        /// Searches begun.
        searches: Sum,
        /// Evaluations of the metric.
        evaluations: Sum,
        /// The metric times the number of edges, mean over the grasps where it is defined.
        min_weight: Mean,
        /// Processor time in seconds.
        cpu_s: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object, its distances, every demonstration and the hand.
    pub struct ForceClosureInputs {
        /// The object, its distances and the demonstrations.
        with given: GraspInputs;
    }
    files {
        /// The hand.
        hand: Hand = hand_files::hand;
    }
}

impl Stage for ForceClosure {
    type Config = ForceClosureConfig;

    const KIND: &'static str = "force_closure";
    const ABOUT: &'static str = "Searches fingertip grasps in force closure, and reaches for them";
    const INPUTS: &'static [&'static str] = ForceClosureInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self];

    /// Checks the hand and its table.
    fn prepare(config: &ForceClosureConfig) -> Result<(), BoxedDiagnostic> {
        let hand = hand_files::load(&config.hand, &config.hand_table)?;
        tips(&hand)?;
        let joints = &config.flexion_joints;
        HandBody::new(hand.model.clone(), joints, hand.mid_range)?;
        Ok(())
    }
}

impl Output for ForceClosure {
    type Stage = Self;
    type Metrics = ForceClosureMetrics;
    type Inputs<'a> = ForceClosureInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    /// `objects` only chooses units.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects"]);
    const LINE: Option<Line<ForceClosureMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [n, feasible] = [metrics.candidates, metrics.feasible];
        if metrics.searches > 0.0 {
            let searches = metrics.searches;
            format!(
                "{} objects → {n} grasps, {feasible} feasible, {searches} searches",
                summary.n_made
            )
        } else {
            format!(
                "{} objects → {n} random palms, {feasible} feasible",
                summary.n_made
            )
        }
    });

    fn units(config: &ForceClosureConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = ForceClosureInputs::units(scope, &config.objects)?;
        Ok(HandFiles::of(&config.hand, &config.hand_table)?.added_to_each(units))
    }

    fn make(
        config: &ForceClosureConfig,
        inputs: ForceClosureInputs,
        cx: &Context,
    ) -> Result<Outcome<ForceClosureMetrics>, BoxedDiagnostic> {
        let ForceClosureInputs {
            given:
                GraspInputs {
                    object,
                    field,
                    trajectories,
                },
            hand,
        } = inputs;
        let joints = hand.model.joint_names();
        let starts = Start::of(&trajectories, &joints)?;
        let grasp_q = Start::mean_grasp(&trajectories, &joints)?;
        let body = HandBody::new(hand.model.clone(), &config.flexion_joints, grasp_q)?;
        let search = GraspSearch {
            config,
            hand: &hand,
            body: &body,
            object: &object,
            tips: &tips(&hand)?,
        };
        let generator = GENERATORS[usize::from(config.max_iterations == 0)];
        let reach = Reach::new(&body, &config.approach, generator, &object.name);
        let attempts = Attempts::new(&object, field, config.approach.rests, cx.seed());
        let measured = attempts.results(config.per_object, |number, environment, rng| {
            let start = Start::draw(&starts, rng);
            let Some(found) = search.grasp(environment, rng)? else {
                return Ok::<_, BoxedDiagnostic>(None);
            };
            let grasp = Grasp {
                hand: found.hand.clone(),
                depth_m: found.depth_m,
                residual_m2: Some(found.residual_m2),
            };
            let candidate = reach.candidate(number, environment, &grasp, start)?;
            Ok(Some((candidate, found)))
        })?;
        let cpu_s = measured.iter().map(|(_, cpu_s)| cpu_s).sum();
        let made = measured.into_iter().filter_map(|(made, _)| made);
        let made: Vec<(Candidate, FoundGrasp)> = made.collect();
        if made.is_empty() {
            return Ok(Outcome::skipped(
                "something is in the way of every palm about the object",
            ));
        }
        let metrics = metrics(&made, cpu_s);
        let candidates = made.into_iter().map(|(candidate, _)| candidate);
        cx.write(&reach.table(candidates.collect()))?;
        Ok(Outcome::Made(metrics))
    }
}

/// Searches grasps of one object.
struct GraspSearch<'a> {
    config: &'a ForceClosureConfig,
    hand: &'a Hand,
    body: &'a HandBody,
    object: &'a Object,
    tips: &'a [Tip],
}

impl GraspSearch<'_> {
    /// Searches a grasp of the object as it lies; `None` if something is in the way of every palm.
    fn grasp(
        &self,
        environment: &Environment,
        rng: &mut ChaCha8Rng,
    ) -> Result<Option<FoundGrasp>, BoxedDiagnostic> {
        let search = Search {
            hand: self.hand,
            body: self.body,
            config: self.config,
            environment,
            contact_model: contact_model(self.config, self.object),
            tips: self.tips,
        };
        search.grasp(rng)
    }
}

/// Returns the parameters of the contacts of an object: torques about its center of mass, over the mean distance of its
/// surface from there.
fn contact_model(config: &ForceClosureConfig, object: &Object) -> ContactModel {
    let center_in_object = Point3::from(object.center_of_mass_m);
    let points = object.points_m.iter();
    let far = points.map(|&point| (Point3::from(point) - center_in_object).norm());
    let mean_m = far.sum::<f64>() / object.points_m.len().max(1) as f64;
    ContactModel {
        center_in_object,
        length_m: mean_m.max(MIN_LENGTH_M),
        friction: config.friction,
        edges: config.edges,
    }
}

fn metrics(made: &[(Candidate, FoundGrasp)], cpu_s: f64) -> ForceClosureMetrics {
    let found = || made.iter().map(|(_, found)| found);
    let sum = |of: fn(&FoundGrasp) -> u64| found().map(of).sum::<u64>() as f64;
    let weights: Vec<f64> = found().filter_map(|one| one.min_weight).collect();
    ForceClosureMetrics {
        candidates: sum(|_| 1),
        feasible: sum(|one| u64::from(one.is_feasible)),
        palms: sum(|one| one.work.palms),
        searches: sum(|one| one.work.searches),
        evaluations: sum(|one| one.work.evaluations),
        min_weight: weights.iter().sum::<f64>() / weights.len().max(1) as f64,
        cpu_s,
    }
}

/// Returns the hand's fingertips.
///
/// # Errors
///
/// Fails if its table marks fewer than three.
pub(crate) fn tips(hand: &Hand) -> Result<Vec<Tip>, ForceClosureError> {
    let points = hand.points.iter().enumerate();
    let tips = points.filter_map(|(point, of_hand)| {
        let radius_m = of_hand.tip_radius_m?;
        Some(Tip { point, radius_m })
    });
    let tips: Vec<Tip> = tips.collect();
    if tips.len() < FEWEST_TIPS {
        return Err(ForceClosureError::FewTips { found: tips.len() });
    }
    Ok(tips)
}

#[cfg(test)]
mod tests {
    use schemas::candidates::Origin;

    use super::*;
    use crate::fixture;

    /// Runs the stage on the box; returns what it measured and wrote.
    fn run(
        config: &ForceClosureConfig,
        seed: u64,
        with_field: bool,
    ) -> (Outcome<ForceClosureMetrics>, Option<Candidates>) {
        let trajectories = fixture::trajectories();
        fixture::BOX.candidates::<ForceClosure>(config, &trajectories, with_field, seed)
    }

    fn small() -> ForceClosureConfig {
        ForceClosureConfig {
            per_object: 3,
            ..fixture::config()
        }
    }

    #[test]
    fn every_grasp_of_the_box_is_a_motion_that_ends_in_it() {
        let (outcome, made) = run(&small(), 3, true);
        let Outcome::Made(metrics) = outcome else {
            panic!("not made");
        };
        let made = made.unwrap();
        assert_eq!([metrics.candidates, metrics.feasible], [3.0, 3.0]);
        assert!(metrics.searches >= 3.0 && metrics.evaluations > metrics.searches);
        assert!((0.3..=1.0).contains(&metrics.min_weight), "{metrics:?}");
        let names: Vec<&str> = made
            .candidates
            .iter()
            .map(|one| one.candidate_id.as_str())
            .collect();
        assert_eq!(names, ["box-00000", "box-00001", "box-00002"]);
        for one in &made.candidates {
            assert_eq!(
                (one.generator.as_str(), one.source.origin),
                ("force_closure", Origin::Grasp)
            );
            assert_eq!(one.motion.steps().len(), 40);
            assert!(one.depth_m <= Some(1e-3));
        }
    }

    #[test]
    fn without_iterations_there_are_random_palms_of_another_name() {
        let config = ForceClosureConfig {
            max_iterations: 0,
            ..small()
        };
        let (outcome, made) = run(&config, 3, true);
        let Outcome::Made(metrics) = outcome else {
            panic!("not made");
        };
        assert!(metrics.searches.abs() < 1e-12 && metrics.palms >= 3.0);
        assert!(
            made.unwrap()
                .candidates
                .iter()
                .all(|one| one.generator == "random_palm")
        );
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
            ForceClosure::units(&ForceClosureConfig { objects, ..small() }, scope)
        });
    }

    #[test]
    fn options_out_of_bounds_are_named() {
        assert!(ForceClosure::check(&small()).is_empty());
        let mut bad = small();
        bad.per_object = 0;
        bad.friction = f64::NAN;
        bad.flexion_joints = Vec::new();
        bad.approach.steps = 1;
        let keys: Vec<String> = ForceClosure::check(&bad)
            .into_iter()
            .map(|fault| fault.key)
            .collect();
        assert_eq!(
            keys,
            ["per_object", "friction", "approach.steps", "flexion_joints"]
        );
    }
}
