//! The pregrasp: the posture near a grasp in which the hand keeps clear of object and table.

use nalgebra::Point3;
use posture::{
    CollisionPenalty, Environment, EnvironmentTerms, Hand, Loss, NoTerms, Posture, PosturePrior,
    RootMotion, SearchOptions, Solver, SolverError, Target, Task,
};

use crate::configuration::Configuration;

/// Weight of a point's distance from where it is at the grasp.
const POSITION_WEIGHT: f64 = 0.1;
/// Weight of a joint's distance from where it is at the grasp, in m/rad: a radian counts as 5 mm.
const JOINT_WEIGHT: f64 = 0.005;
/// Weight of a link's depth in the clearance: thirty times a point's.
const CLEARANCE_WEIGHT: f64 = 3.0;
/// Most postures that are tried.
const MAX_ITERATIONS: usize = 60;

/// Searches pregrasps of one hand.
pub(crate) struct PregraspSearch<'a> {
    hand: &'a Hand,
    solver: Solver<'a>,
}

/// A posture near a grasp.
#[derive(Debug, Clone)]
pub(crate) struct Pregrasp {
    /// The hand.
    pub(crate) at: Configuration,
    /// Postures tried, each against object and table.
    pub(crate) checks_n: u64,
}

impl<'a> PregraspSearch<'a> {
    /// Takes a hand.
    pub(crate) fn new(hand: &'a Hand) -> Self {
        Self {
            hand,
            solver: Solver::new(&hand.compiled),
        }
    }

    /// Returns the posture nearest to a grasp whose links keep a distance from object and table, in meters, as far as
    /// they can: palm and joints move as little as possible for it, the least squares of both.
    ///
    /// # Errors
    ///
    /// Fails if the grasp is not one of the hand.
    pub(crate) fn near(
        &mut self,
        environment: &Environment,
        grasp: &Configuration,
        clearance_m: f64,
    ) -> Result<Pregrasp, SolverError> {
        let mut posture = Posture::new(&grasp.object_from_palm, grasp.q.clone());
        let points = self.points(&posture)?;
        let targets = points.iter().zip(&self.hand.points).enumerate();
        let targets: Vec<Target> = targets
            .map(|(point, (at, of_hand))| Target {
                point,
                point_in_object: *at,
                weight: (POSITION_WEIGHT * of_hand.weight).powi(2),
            })
            .collect();
        let prior = PosturePrior {
            q: &grasp.q,
            weight: JOINT_WEIGHT.powi(2),
        };
        let mut terms = EnvironmentTerms {
            hand: self.hand,
            environment,
            collision_penalty: CollisionPenalty {
                object_weight: CLEARANCE_WEIGHT,
                clearance_m,
                table_weight: CLEARANCE_WEIGHT,
                table_margin_m: clearance_m,
            },
            contacts: Vec::new(),
        };
        let options = SearchOptions::new(MAX_ITERATIONS, RootMotion::Free);
        let task = task(&targets, Some(prior));
        let solver = &mut self.solver;
        let outcome = solver.minimize(&task, &mut posture, &options, &mut terms)?;
        Ok(Pregrasp {
            at: Configuration {
                object_from_palm: posture.root.pose(),
                q: posture.q,
            },
            checks_n: outcome.iterations as u64,
        })
    }

    /// Returns where the hand's points are.
    fn points(&mut self, posture: &Posture) -> Result<Vec<Point3<f64>>, SolverError> {
        self.solver.place(&task(&[], None), posture, &mut NoTerms)?;
        let posed = self.solver.posed();
        let points = 0..self.hand.points.len();
        Ok(points.filter_map(|point| posed.point(point)).collect())
    }
}

fn task<'t>(targets: &'t [Target], prior: Option<PosturePrior<'t>>) -> Task<'t> {
    Task {
        targets,
        loss: Loss::Squared,
        vectors: None,
        smoothness: None,
        prior,
    }
}
