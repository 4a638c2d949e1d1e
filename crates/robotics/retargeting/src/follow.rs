//! One step of a motion: the posture for its goal.

use nalgebra::Point3;
use posture::{
    CollisionPenalty, ContactTarget, Environment, EnvironmentTerms, Hand, NoTerms, Posed, Posture,
    PosturePrior, SearchOptions, Smoothness, Solver, Target, Task,
};
use spatial::Pose;

use crate::{
    Loss, RetargetingConfig, RetargetingError, Tracking, Wrist,
    goal::{Goal, PointGoal},
};

/// Iterations at the grasp relative to other steps: it starts from nothing.
const GRASP_ITERATIONS: usize = 3;

/// Steps before the grasp from which the approach is followed, as another way to the grasp.
const APPROACH: usize = 16;

/// Factor on the object's weight on the way from a hand that knows of no object to one that keeps
/// out of it: at once, it would be pushed out on whichever side is nearest.
const SOFT: f64 = 0.1;

/// Weight that draws joints without any other say to the middle of their range, in m/rad: far below
/// what a landmark says, enough to make the answer unique.
const TIE_BREAK_WEIGHT: f64 = 1e-3;

/// A step that was solved.
#[derive(Debug, Clone)]
pub(crate) struct StepSolution {
    /// The posture.
    pub(crate) posture: Posture,
    /// Positions of the followed points, object frame, in meters.
    pub(crate) points: Vec<Point3<f64>>,
    /// The cost of all terms, in m².
    pub(crate) cost: f64,
    /// Number of postures tried.
    pub(crate) iterations: usize,
    /// Tracking error and clearances.
    pub(crate) tracking: Tracking,
}

/// Searches the steps of one motion.
pub(crate) struct Follower<'a> {
    context: StepContext<'a>,
    solver: Solver<'a>,
}

/// Treatment of fingers that end at a joint limit.
#[derive(Clone, Copy)]
enum Fingers {
    /// As the search that follows the motion leaves them.
    AsTheyCome,
    /// The other way, too, if that is better.
    TriedBothWays,
}

/// Constants of all steps.
#[derive(Clone, Copy)]
struct StepContext<'a> {
    hand: &'a Hand,
    environment: &'a Environment,
    config: &'a RetargetingConfig,
}

impl<'a> Follower<'a> {
    /// Returns a follower for a hand among these things.
    pub(crate) fn new(
        hand: &'a Hand,
        environment: &'a Environment,
        config: &'a RetargetingConfig,
    ) -> Self {
        Self {
            context: StepContext {
                hand,
                environment,
                config,
            },
            solver: Solver::new(&hand.compiled),
        }
    }

    /// Searches a step from the one solved before it.
    pub(crate) fn step(
        &mut self,
        goal: &Goal,
        before: &StepSolution,
    ) -> Result<StepSolution, RetargetingError> {
        let start = before.posture.clone();
        self.search(
            goal,
            Some(before),
            start,
            self.context.config.max_iterations,
        )
    }

    /// Searches a step of which nothing is known before: as a grasp that nothing approaches.
    pub(crate) fn first(&mut self, goal: &Goal) -> Result<StepSolution, RetargetingError> {
        let afresh = self.afresh(goal, None)?;
        let start = afresh.map_or_else(
            || self.aligned_to_targets(goal, self.context.hand.mid_range.clone()),
            |afresh| Ok(afresh.posture),
        )?;
        let iterations = GRASP_ITERATIONS * self.context.config.max_iterations;
        self.search_with(goal, None, start, iterations, Fingers::TriedBothWays)
    }

    /// Searches the grasp, the last step: afresh, and along the approach, where the fingers come
    /// from outside and so end on the right side of thin things.
    pub(crate) fn grasp(
        &mut self,
        goals: &[Goal],
    ) -> Result<Option<StepSolution>, RetargetingError> {
        let Some((goal, before)) = goals.split_last() else {
            return Ok(None);
        };
        let Some(afresh) = self.afresh(goal, None)? else {
            return Ok(None);
        };
        let iterations = GRASP_ITERATIONS * self.context.config.max_iterations;
        let best = match self.approach(before)? {
            Some(start) => cheaper(afresh, self.search(goal, None, start, iterations)?),
            None => afresh,
        };
        // All other steps follow from this one.
        let fingers = Fingers::TriedBothWays;
        let turned = self.search_with(goal, None, best.posture.clone(), iterations, fingers)?;
        Ok(Some(cheaper(best, turned)))
    }

    /// Follows the last steps before the grasp forward in time, and returns the last one's posture.
    fn approach(&mut self, before: &[Goal]) -> Result<Option<Posture>, RetargetingError> {
        let from = before.len().saturating_sub(APPROACH);
        let mut last: Option<StepSolution> = None;
        for goal in before.get(from..).unwrap_or(&[]) {
            last = Some(if let Some(last) = last {
                self.step(goal, &last)?
            } else {
                let start = self.aligned_to_targets(goal, self.context.hand.mid_range.clone())?;
                self.search(goal, None, start, self.context.config.max_iterations)?
            });
        }
        Ok(last.map(|last| last.posture))
    }

    /// Searches a step from several starts: first as if the object and the table were not there,
    /// then with a soft object, then with all as it is.
    pub(crate) fn afresh(
        &mut self,
        goal: &Goal,
        before: Option<&StepSolution>,
    ) -> Result<Option<StepSolution>, RetargetingError> {
        let targets = self.context.targets(goal);
        let task = self.context.task(&targets, before);
        let mut starts = self.solver.initial_postures(&task)?;
        let options = self.context.options(self.context.config.max_iterations);
        for start in &mut starts {
            if self.context.config.wrist == Wrist::Fixed {
                *start = self.aligned_to_targets(goal, start.q.clone())?;
            }
            let task = self.context.task(&targets, before);
            self.solver.minimize(&task, start, &options, &mut NoTerms)?;
        }
        let iterations = GRASP_ITERATIONS * self.context.config.max_iterations;
        let mut best: Option<StepSolution> = None;
        for mut start in starts {
            let mut soft = self.context.terms(goal, SOFT);
            let task = self.context.task(&targets, before);
            self.solver
                .minimize(&task, &mut start, &options, &mut soft)?;
            let found = self.search(goal, before, start, iterations)?;
            best = Some(match best {
                Some(best) => cheaper(best, found),
                None => found,
            });
        }
        Ok(best)
    }

    /// Searches a step from a posture.
    fn search(
        &mut self,
        goal: &Goal,
        before: Option<&StepSolution>,
        start: Posture,
        iterations: usize,
    ) -> Result<StepSolution, RetargetingError> {
        // Landmarks alone are cheap enough for it at every step.
        let fingers = if self.context.is_alone() {
            Fingers::TriedBothWays
        } else {
            Fingers::AsTheyCome
        };
        self.search_with(goal, before, start, iterations, fingers)
    }

    /// Searches a step from a posture, and perhaps from that with fingers bent the other way.
    fn search_with(
        &mut self,
        goal: &Goal,
        before: Option<&StepSolution>,
        start: Posture,
        iterations: usize,
        fingers: Fingers,
    ) -> Result<StepSolution, RetargetingError> {
        let mut posture = match self.context.config.wrist {
            Wrist::Free => start,
            Wrist::Fixed => self.aligned_to_targets(goal, start.q)?,
        };
        let targets = self.context.targets(goal);
        let task = self.context.task(&targets, before);
        let mut terms = self.context.terms(goal, 1.0);
        let options = self.context.options(iterations);
        let solver = &mut self.solver;
        let outcome = match fingers {
            Fingers::AsTheyCome => solver.minimize(&task, &mut posture, &options, &mut terms)?,
            Fingers::TriedBothWays => {
                solver.minimize_with_flips(&task, &mut posture, &options, &mut terms)?
            }
        };
        let cost = self.solver.place(&task, &posture, &mut terms)?;
        let posed = self.solver.posed();
        let points = (0..self.context.hand.points.len())
            .filter_map(|idx| posed.point(idx))
            .collect::<Vec<_>>();
        let tracking = self
            .context
            .tracking(goal, &posed, &points, &terms, &posture.q);
        Ok(StepSolution {
            posture,
            points,
            cost,
            iterations: outcome.iterations,
            tracking,
        })
    }

    /// Measures how well a posture follows.
    pub(crate) fn measured(
        &mut self,
        goal: &Goal,
        posture: &Posture,
    ) -> Result<Tracking, RetargetingError> {
        let mut terms = self.context.terms(goal, 1.0);
        let targets = self.context.targets(goal);
        let task = self.context.task(&targets, None);
        self.solver.place(&task, posture, &mut terms)?;
        let posed = self.solver.posed();
        let points: Vec<_> = (0..self.context.hand.points.len())
            .filter_map(|idx| posed.point(idx))
            .collect();
        let (context, q) = (self.context, &posture.q);
        Ok(context.tracking(goal, &posed, &points, &terms, q))
    }

    /// Returns the posture with these joint positions whose points lie nearest to the landmarks;
    /// those on the palm alone, if the wrist is fixed.
    fn aligned_to_targets(
        &mut self,
        goal: &Goal,
        q: Vec<f64>,
    ) -> Result<Posture, RetargetingError> {
        let posture = Posture::new(&Pose::identity(), q);
        let mut targets = self.context.targets(goal);
        if self.context.config.wrist == Wrist::Fixed {
            targets.retain(|target| self.context.hand.palm_points.contains(&target.point));
            for target in &mut targets {
                target.weight = 1.0;
            }
        }
        let task = Task {
            targets: &targets,
            loss: posture::Loss::Squared,
            vectors: None,
            smoothness: None,
            prior: None,
        };
        Ok(self.solver.aligned_to_targets(&task, posture)?)
    }
}

impl<'a> StepContext<'a> {
    /// Returns how well the hand follows at a posture, with its points there.
    fn tracking(
        self,
        goal: &Goal,
        posed: &Posed<'_>,
        points: &[Point3<f64>],
        terms: &EnvironmentTerms<'_>,
        q: &[f64],
    ) -> Tracking {
        let mut tracking = Tracking {
            limit_margin_rad: self.hand.limit_margin(q),
            penetration_m: terms.object_depth_m(posed),
            table_penetration_m: terms.table_depth_m(posed),
            ..Tracking::default()
        };
        let goals = self.hand.points.iter().zip(&goal.points);
        for ((point, goal), found) in goals.zip(points) {
            if point.weight == 0.0 {
                continue;
            }
            let distance = (found - goal.shown).norm();
            tracking.keypoint_errors_m.push(distance);
            if let Some(radius_m) = point.tip_radius_m {
                tracking.tip_errors_m.push(distance);
                if goal.contact.is_some() {
                    let gap = self.environment.signed_distance(found).distance_m - radius_m;
                    tracking.contact_gaps_m.push(gap);
                }
            }
        }
        tracking
    }

    /// Returns where the followed points should be.
    fn targets(self, goal: &Goal) -> Vec<Target> {
        // So that both losses are the squared distance where it is small.
        let unit = match self.config.loss {
            Loss::Squared => 1.0,
            Loss::SmoothL1 => 2.0 * self.config.smooth_l1_beta_m,
        };
        goal.points
            .iter()
            .enumerate()
            .map(|(point, goal)| Target {
                point,
                point_in_object: goal.landmark,
                weight: unit * goal.weight.powi(2),
            })
            .collect()
    }

    /// Returns what is asked of the hand alone.
    fn task<'t>(self, targets: &'t [Target], before: Option<&'t StepSolution>) -> Task<'t>
    where
        'a: 't,
    {
        let config = self.config;
        let joint_weight = config.joint_smoothness_weight.powi(2);
        Task {
            targets,
            loss: match config.loss {
                Loss::Squared => posture::Loss::Squared,
                Loss::SmoothL1 => posture::Loss::SmoothL1 {
                    beta_m: config.smooth_l1_beta_m,
                },
            },
            vectors: None,
            smoothness: before.map(|before| Smoothness {
                points: &before.points,
                point_weight: config.smoothness_weight.powi(2),
                posture: &before.posture,
                joint_weight,
                root_weight: 0.0,
            }),
            prior: (before.is_none() || joint_weight == 0.0).then_some(PosturePrior {
                q: &self.hand.mid_range,
                weight: TIE_BREAK_WEIGHT.powi(2),
            }),
        }
    }

    /// Says whether nothing but the landmarks has a say.
    fn is_alone(self) -> bool {
        let config = self.config;
        let weights = [
            config.object_weight,
            config.table_weight,
            config.contact_weight,
        ];
        weights.iter().all(|weight| *weight <= 0.0)
    }

    /// Returns what the object and the table ask, the object as firmly as this.
    fn terms<'t>(self, goal: &'t Goal, firmness: f64) -> EnvironmentTerms<'t>
    where
        'a: 't,
    {
        let config = self.config;
        let contact = |(point, goal): (usize, &PointGoal)| {
            let contact = goal.contact.filter(|_| config.contact_weight > 0.0)?;
            Some(ContactTarget {
                point,
                distance_m: contact.distance_m,
                weight: contact.weight,
            })
        };
        EnvironmentTerms {
            hand: self.hand,
            environment: self.environment,
            collision_penalty: CollisionPenalty {
                object_weight: firmness * config.object_weight,
                clearance_m: goal.clearance_m,
                table_weight: config.table_weight,
                table_margin_m: config.table_margin_m,
            },
            contacts: goal.points.iter().enumerate().filter_map(contact).collect(),
        }
    }

    fn options(self, max_iterations: usize) -> SearchOptions {
        let root_motion = match self.config.wrist {
            Wrist::Free => posture::RootMotion::Free,
            Wrist::Fixed => posture::RootMotion::Fixed,
        };
        SearchOptions::new(max_iterations, root_motion)
    }
}

/// Returns the one of lower cost, the first if they are equal.
fn cheaper(a: StepSolution, b: StepSolution) -> StepSolution {
    if b.cost < a.cost { b } else { a }
}
