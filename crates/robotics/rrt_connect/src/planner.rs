//! The way of one motion: pregrasp, search, and the motion along the path.

use std::sync::Arc;

use motion::{Motion, MotionError, Step};
use nalgebra::Vector3;
use posture::{Environment, Hand, SolverError};
use rand::Rng;
use robot::RobotModel;
use spatial::Object;

use crate::{
    collision::Obstacles,
    configuration::{Configuration, Region},
    connect::{Checked, Growth, connect},
    path::Path,
    pregrasp::{Pregrasp, PregraspSearch},
};

/// Shares of the clearance that a pregrasp keeps, the most wanted first: where the hand is in a narrow place, less.
const CLEARANCES: [f64; 3] = [1.0, 0.5, 0.25];
/// Range of a joint without limits, in radians, both ways from 0.
const FREE_RANGE_RAD: f64 = std::f64::consts::PI;

/// Parameters of a planner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RrtOptions {
    /// Growth of the trees.
    pub growth: Growth,
    /// Depth in object or table up to which a configuration is free, in meters.
    pub tolerated_depth_m: f64,
    /// Margin of the palm's region beyond start and pregrasp, along each axis of the object, in meters.
    pub margin_m: f64,
    /// Last part of the steps, from 0 to 1, in which the hand closes on a straight line from the pregrasp to the grasp,
    /// without checks.
    pub closing_share: f64,
    /// Distance that the hand keeps from object and table at the pregrasp, as far as it can, in meters.
    pub clearance_m: f64,
    /// Attempts to replace a part of a path by a straight line.
    pub shortcuts: usize,
}

/// Plans ways of one hand.
pub struct RrtPlanner<'a> {
    hand: &'a Hand,
    options: RrtOptions,
    joints: Vec<String>,
    search: PregraspSearch<'a>,
}

/// A planned motion, and its cost.
#[derive(Debug, Clone)]
pub struct RrtPlan {
    /// The hand in the object's frame, with the hand's joints.
    pub motion: Motion<Object>,
    /// Outcome of the search.
    pub outcome: RrtOutcome,
    /// Configurations checked against object and table.
    pub checks_n: u64,
    /// Nodes of both trees.
    pub nodes_n: usize,
    /// Greatest depth in object or table of the motion's steps before the closing, in meters. They are on the path, but
    /// the straight line between two of them may leave it.
    pub depth_m: f64,
}

/// Why a motion could not be planned.
#[derive(Debug, thiserror::Error)]
pub enum RrtError {
    /// Its steps form no motion of the hand.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// Its grasp is not one of the hand.
    #[error(transparent)]
    Solver(#[from] SolverError),
}

/// Outcome of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RrtOutcome {
    /// A path was found.
    Found,
    /// The search ended with its budget.
    NoPath,
    /// The start is in collision, or every pregrasp is: there is nothing to search.
    Unreachable,
}

impl<'a> RrtPlanner<'a> {
    /// Takes a hand.
    pub fn new(hand: &'a Hand, options: RrtOptions) -> Self {
        Self {
            hand,
            options,
            joints: hand.model.joint_names(),
            search: PregraspSearch::new(hand),
        }
    }

    /// Plans a way from the first step of a motion to its last, with its times.
    ///
    /// # Errors
    ///
    /// Fails if the motion's joints are not the hand's, if its steps are so near in time that rates are not finite, or
    /// if the grasp is not one of the hand.
    pub fn plan(
        &mut self,
        environment: &Environment,
        given: &Motion<Object>,
        rng: &mut impl Rng,
    ) -> Result<RrtPlan, RrtError> {
        let given = given.reordered(&self.joints)?;
        let options = self.options;
        let obstacles = Obstacles {
            hand: &self.hand.model,
            collision: &self.hand.collision,
            environment,
        };
        let [start, grasp] = [given.first(), given.grasp()].map(|step| Configuration {
            object_from_palm: step.frame_from_palm,
            q: step.q_rad.clone(),
        });
        let free = |at: &Configuration| obstacles.is_free(at, options.tolerated_depth_m);
        let mut checked = Checked::new(&free);
        let pregrasp = if checked.is_free(&start) {
            self.pregrasp(environment, &grasp, &mut checked)?
        } else {
            None
        };
        let metric = options.growth.metric;
        let searched = pregrasp.as_ref().map(|pregrasp| {
            let region = region(&self.hand.model, [&start, pregrasp], options.margin_m);
            let growth = &options.growth;
            let found = connect([&start, pregrasp], growth, &region, &mut checked, rng);
            let path = found.path.map(|nodes| {
                let path = Path::new(nodes, metric);
                path.shortened(options.shortcuts, growth.spacing, &mut checked, rng)
            });
            (path, found.nearest, found.nodes_n)
        });
        let (outcome, path, nodes_n) = match searched {
            Some((Some(path), _, nodes_n)) => (RrtOutcome::Found, path, nodes_n),
            Some((None, nearest, nodes_n)) => {
                (RrtOutcome::NoPath, Path::new(nearest, metric), nodes_n)
            }
            None => (RrtOutcome::Unreachable, Path::new(vec![start], metric), 0),
        };
        // Of a path that was found, the grasp is the last step, and the pregrasp another one.
        let closing = (outcome == RrtOutcome::Found).then_some((&grasp, options.closing_share));
        let placed = along(&path, given.steps().len(), closing);
        let before_closing = placed.iter().filter(|(_, closes)| !closes);
        let depth_m = before_closing
            .map(|(at, _)| obstacles.depth_m(at))
            .fold(0.0, f64::max);
        let steps = given.steps().iter().zip(placed);
        let steps = steps.map(|(step, (at, _))| Step {
            time_s: step.time_s,
            frame_from_palm: at.object_from_palm,
            q_rad: at.q,
            rates: (),
        });
        let motion = Motion::of_joints(Arc::clone(given.joints()), steps.collect())?;
        Ok(RrtPlan {
            motion: motion.differentiated()?,
            outcome,
            checks_n: checked.checks_n,
            nodes_n,
            depth_m,
        })
    }

    /// Returns the pregrasp of a grasp with the greatest clearance with which there is a free one.
    fn pregrasp(
        &mut self,
        environment: &Environment,
        grasp: &Configuration,
        checked: &mut Checked<'_>,
    ) -> Result<Option<Configuration>, RrtError> {
        for share in CLEARANCES {
            let clearance_m = share * self.options.clearance_m;
            let Pregrasp { at, checks_n } = self.search.near(environment, grasp, clearance_m)?;
            checked.checks_n += checks_n;
            if checked.is_free(&at) {
                return Ok(Some(at));
            }
        }
        Ok(None)
    }
}

/// Returns the region of a search: the joints' limits, and the box about both palms, larger by a margin.
fn region(hand: &RobotModel, ends: [&Configuration; 2], margin_m: f64) -> Region {
    let [a, b] = ends.map(|end| end.object_from_palm.translation.vector);
    let margin = Vector3::repeat(margin_m);
    let limit = |limit: f64| limit.clamp(-FREE_RANGE_RAD, FREE_RANGE_RAD);
    let joints = hand.joints().iter();
    Region {
        palm_m: [a.inf(&b) - margin, a.sup(&b) + margin],
        joints: joints
            .map(|joint| [joint.lower, joint.upper].map(limit))
            .collect(),
    }
}

/// Returns the configurations of `n` steps along a path at constant speed, and whether each belongs to the closing: the
/// last share of the steps, straight from the end of the path to the grasp.
fn along(
    path: &Path,
    n: usize,
    closing: Option<(&Configuration, f64)>,
) -> Vec<(Configuration, bool)> {
    let last = n.saturating_sub(1);
    let closing_n = closing.map_or(0, |(_, share)| share_of(last, share));
    let path_n = last - closing_n;
    let pregrasp = path.at(1.0);
    let step = |idx: usize| match closing {
        Some((grasp, _)) if idx > path_n || idx == last => {
            let share = (idx - path_n) as f64 / closing_n.max(1) as f64;
            let at = if idx == last {
                grasp.clone()
            } else {
                pregrasp.towards(grasp, share)
            };
            (at, true)
        }
        _ => (path.at(idx as f64 / path_n.max(1) as f64), false),
    };
    (0..n).map(step).collect()
}

/// Returns the number of steps that is nearest to a share of them, at least one if there are two.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a number of steps, from 0 to 1"
)]
fn share_of(steps: usize, share: f64) -> usize {
    ((steps as f64 * share).round() as usize).clamp(steps.min(1), steps)
}
