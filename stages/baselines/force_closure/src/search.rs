//! One grasp: from a random palm to fingertips that close on the object.

use approach::{ApproachError, ContactModel, HandBody, Palms};
use dataflow::BoxedDiagnostic;
use motion::HandState;
use posture::{
    CollisionPenalty, ContactTarget, Environment, EnvironmentTerms, Hand, Loss, Posture,
    PosturePrior, RootMotion, SearchOptions, Solver, SolverError, Task,
};
use rand_chacha::ChaCha8Rng;
use spatial::Object;

use crate::{
    ForceClosureConfig,
    contacts::{GraspTerms, Tip},
};

/// Rounds of a search, each with this share of the metric's weight: the penalties gain on it until the violations are
/// below the tolerances.
const ROUNDS: [f64; 3] = [1.0, 0.3, 0.1];
/// Most palms drawn until one is not blocked.
const MAX_PALMS: usize = 1000;

/// A grasp that was found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FoundGrasp {
    pub(crate) hand: HandState<Object>,
    /// The metric times the number of wrenches; `None` if a tip is where the object has no surface, or nothing was
    /// searched.
    pub(crate) min_weight: Option<f64>,
    /// Greatest distance of a fingertip from the surface, in meters.
    pub(crate) gap_m: f64,
    /// Greatest depth of a link in object or table, in meters.
    pub(crate) depth_m: f64,
    /// Weighted squares of gaps and depths, and of the metric's shortfall from its least value, in m².
    pub(crate) residual_m2: f64,
    /// Whether the grasp is feasible: within the tolerances, and the metric large enough.
    pub(crate) is_feasible: bool,
    pub(crate) work: Work,
}

/// Work spent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Work {
    /// Palms drawn, blocked ones included.
    pub(crate) palms: u64,
    /// Searches begun.
    pub(crate) searches: u64,
    /// Evaluations of the metric.
    pub(crate) evaluations: u64,
}

/// Searches grasps of one object that lies in one way.
pub(crate) struct Search<'a> {
    pub(crate) hand: &'a Hand,
    pub(crate) body: &'a HandBody,
    pub(crate) config: &'a ForceClosureConfig,
    pub(crate) environment: &'a Environment,
    pub(crate) contact_model: ContactModel,
    pub(crate) tips: &'a [Tip],
}

impl Search<'_> {
    /// Returns a grasp: the first that is feasible, or else the one with the least residual; with no iterations the
    /// first random palm, its fingers closed. `None` if something is in the way of every palm.
    pub(crate) fn grasp(
        &self,
        rng: &mut ChaCha8Rng,
    ) -> Result<Option<FoundGrasp>, BoxedDiagnostic> {
        let mut solver = Solver::new(&self.hand.compiled);
        let mut work = Work::default();
        let mut best: Option<FoundGrasp> = None;
        for _ in 0..self.config.searches {
            let Some(start) = self.start(rng, &mut work)? else {
                break;
            };
            let found = if self.config.max_iterations == 0 {
                self.measured(&mut solver, start, &mut work)?
            } else {
                work.searches += 1;
                let searched = self
                    .searched(&mut solver, &start, &mut work)
                    .map_err(BoxedDiagnostic::without_hint)?;
                self.measured(&mut solver, searched, &mut work)?
            };
            let is_done = found.is_feasible || self.config.max_iterations == 0;
            if best
                .as_ref()
                .is_none_or(|best| is_done || found.residual_m2 < best.residual_m2)
            {
                best = Some(found);
            }
            if is_done {
                break;
            }
        }
        Ok(best.map(|found| FoundGrasp { work, ..found }))
    }

    /// Draws a palm that is not blocked, and closes its fingers.
    fn start(
        &self,
        rng: &mut ChaCha8Rng,
        work: &mut Work,
    ) -> Result<Option<HandState<Object>>, ApproachError> {
        let palms = Palms {
            body: self.body,
            environment: self.environment,
            center_in_object: self.contact_model.center_in_object,
            jitter_m: self.config.palm_jitter_m,
        };
        for _ in 0..MAX_PALMS {
            work.palms += 1;
            if let Some(open) = palms.draw(rng)? {
                return self.body.closed(self.environment, &open).map(Some);
            }
        }
        Ok(None)
    }

    /// Moves a hand until its fingertips touch and the metric is greatest nearby.
    fn searched(
        &self,
        solver: &mut Solver<'_>,
        start: &HandState<Object>,
        work: &mut Work,
    ) -> Result<HandState<Object>, SolverError> {
        let prior = PosturePrior {
            q: &start.q_rad,
            weight: self.config.joint_weight.powi(2),
        };
        let task = Task {
            targets: &[],
            loss: Loss::Squared,
            vectors: None,
            smoothness: None,
            prior: Some(prior),
        };
        let iterations = self.config.max_iterations.div_ceil(ROUNDS.len());
        let options = SearchOptions::new(iterations, RootMotion::Free);
        let mut posture = Posture::new(&start.frame_from_palm, start.q_rad.clone());
        for share in ROUNDS {
            let mut terms = self.terms(share * self.config.min_weight_weight_m);
            solver.minimize(&task, &mut posture, &options, &mut terms)?;
            work.evaluations += terms.evaluations;
        }
        Ok(HandState {
            frame_from_palm: posture.root.pose(),
            q_rad: posture.q,
        })
    }

    /// Measures a grasp against its requirements.
    fn measured(
        &self,
        solver: &mut Solver<'_>,
        hand: HandState<Object>,
        work: &mut Work,
    ) -> Result<FoundGrasp, BoxedDiagnostic> {
        let config = self.config;
        let nothing = Task {
            targets: &[],
            loss: Loss::Squared,
            vectors: None,
            smoothness: None,
            prior: None,
        };
        let mut terms = self.terms(0.0);
        let posture = Posture::new(&hand.frame_from_palm, hand.q_rad.clone());
        let residual_m2 = solver
            .place(&nothing, &posture, &mut terms)
            .map_err(BoxedDiagnostic::without_hint)?;
        let posed = solver.posed();
        let depth_m = terms.surroundings.object_depth_m(&posed);
        let depth_m = depth_m.max(terms.surroundings.table_depth_m(&posed));
        let min_weight = terms.metric(&posed).map(|(metric, _)| metric.normalized);
        work.evaluations += terms.evaluations;
        let gaps = self.tips.iter().filter_map(|tip| {
            let at = posed.point(tip.point)?;
            Some((self.environment.signed_distance(&at).distance_m - tip.radius_m).abs())
        });
        let gap_m = gaps.fold(0.0, f64::max);
        // Without a normal somewhere the metric is as far from its least value as it can well be.
        let lacks = (config.min_weight - min_weight.unwrap_or(-1.0)).max(0.0);
        Ok(FoundGrasp {
            hand,
            min_weight,
            gap_m,
            depth_m,
            residual_m2: residual_m2 + (config.min_weight_weight_m * lacks).powi(2),
            is_feasible: lacks <= 0.0 && gap_m <= config.max_gap_m && depth_m <= config.max_depth_m,
            work: *work,
        })
    }

    fn terms(&self, weight_m: f64) -> GraspTerms<'_> {
        let contacts = self.tips.iter().map(|tip| ContactTarget {
            point: tip.point,
            distance_m: tip.radius_m,
            weight: self.config.contact_weight,
        });
        GraspTerms {
            surroundings: EnvironmentTerms {
                hand: self.hand,
                environment: self.environment,
                collision_penalty: CollisionPenalty {
                    object_weight: self.config.object_weight,
                    clearance_m: 0.0,
                    table_weight: self.config.table_weight,
                    table_margin_m: self.config.table_margin_m,
                },
                contacts: contacts.collect(),
            },
            tips: self.tips,
            contact_model: self.contact_model,
            weight_m,
            evaluations: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::fixture;

    fn grasps(config: &ForceClosureConfig, n: u64) -> Vec<FoundGrasp> {
        let (hand, body) = fixture::hand();
        let environment = fixture::BOX.environment();
        let tips = crate::force_closure::tips(&hand).unwrap();
        let search = Search {
            hand: &hand,
            body: &body,
            config,
            environment: &environment,
            contact_model: fixture::contact_model(),
            tips: &tips,
        };
        let grasp = |seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            search.grasp(&mut rng).unwrap().unwrap()
        };
        (0..n).map(grasp).collect()
    }

    #[test]
    fn a_search_ends_with_every_tip_on_the_box_in_force_closure_within_the_limits() {
        let config = fixture::config();
        let (hand, _) = fixture::hand();
        for found in grasps(&config, 6) {
            assert!(found.is_feasible, "{found:?}");
            assert!(found.min_weight.unwrap() >= 0.3);
            assert!(found.gap_m <= 1e-3 && found.depth_m <= 1e-3, "{found:?}");
            for (q, joint) in found.hand.q_rad.iter().zip(hand.model.joints()) {
                assert!((joint.lower..=joint.upper).contains(q), "{q} {joint:?}");
            }
            assert!(found.work.evaluations > 0 && found.work.searches > 0);
        }
    }

    #[test]
    fn random_palms_are_not_searched_and_are_seldom_as_they_should_be() {
        let config = ForceClosureConfig {
            max_iterations: 0,
            ..fixture::config()
        };
        let random = grasps(&config, 12);
        assert!(random.iter().all(|found| found.work.searches == 0));
        assert!(
            random.iter().all(|found| found.depth_m < 2e-3),
            "{random:?}"
        );
        let feasible = random.iter().filter(|found| found.is_feasible).count();
        assert!(feasible < 4, "{feasible}");
    }

    /// On flat sides wrenches are linear in the places, so that the gradient is exact, off the metric's kinks.
    #[test]
    fn gradient_of_the_metric_by_a_tip_is_that_of_the_metric() {
        let config = fixture::config();
        let (hand, body) = fixture::hand();
        let environment = fixture::BOX.environment();
        let tips = crate::force_closure::tips(&hand).unwrap();
        let search = Search {
            hand: &hand,
            body: &body,
            config: &config,
            environment: &environment,
            contact_model: fixture::contact_model(),
            tips: &tips,
        };
        let mut terms = search.terms(1.0);
        let places = [
            [-0.042, 0.005, 0.01],
            [0.042, 0.008, -0.02],
            [0.042, -0.012, 0.03],
            [0.01, 0.042, 0.002],
        ];
        let places = places.map(nalgebra::Point3::from);
        let metric = terms.metric_at(&places).unwrap();
        let mut largest = 0.0_f64;
        for tip in 0..4 {
            let gradient = terms.gradient(&metric, tip, &places[tip], &tips[tip]);
            for axis in 0..3 {
                const H_M: f64 = 1e-6;
                let mut moved = |by_m: f64| {
                    let mut places = places;
                    places[tip][axis] += by_m;
                    terms.metric_at(&places).unwrap().normalized
                };
                let expected = (moved(H_M) - moved(-H_M)) / (2.0 * H_M);
                let found = gradient[axis];
                assert!(
                    (found - expected).abs() < 1e-3 * (1.0 + expected.abs()),
                    "{tip} {axis}: {found} {expected}"
                );
                largest = largest.max(found.abs());
            }
        }
        assert!(largest > 1.0, "{largest}");
    }
}
