//! Newton's method within joint limits.

use nalgebra::Vector3;

use crate::{
    SolverError,
    arrow::{LinearSolver, eliminator},
    compiled::{CompiledHand, Root},
    evaluate::{Evaluation, Posed, State},
    moments::HessianForm,
    pairs::PairFactors,
    posture::{Posture, RootPose},
    task::{Task, Terms},
};

/// Damping after the first step that failed, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-2;
/// Damping below which there is none.
const MIN_DAMPING: f64 = 1e-4;
/// Damping at which nothing more is to be found.
const MAX_DAMPING: f64 = 1e10;
/// Share of the predicted decrease that a step must bring.
const MIN_SHARE: f64 = 1e-4;
/// Maximum difference of the share from 1 for the expansion to be reused.
const SHARE_TOLERANCE: f64 = 0.3;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOptions {
    /// Greatest predicted decrease at convergence, as a share of the cost.
    pub relative_tolerance: f64,
    /// The same in the cost's own unit, for costs near 0.
    pub min_decrease: f64,
    /// Maximum number of iterations.
    pub max_iterations: usize,
    /// Whether the root moves.
    pub root_motion: RootMotion,
}

impl SearchOptions {
    /// Returns options for costs in m², such as those of a step of a motion: a search ends when a further iteration
    /// would bring no more than a ten-thousandth of the cost, or a thirtieth of a millimeter, squared.
    pub fn new(max_iterations: usize, root_motion: RootMotion) -> Self {
        Self {
            relative_tolerance: 1e-4,
            min_decrease: 1e-9,
            max_iterations,
            root_motion,
        }
    }
}

/// Whether the root moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RootMotion {
    /// It moves, if the hand was compiled with a root that does.
    Free,
    /// It stays where it starts.
    Fixed,
}

/// Result of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOutcome {
    /// The cost at the posture found.
    pub cost: f64,
    /// Decrease that the quadratic model still predicts within the limits, in the cost's unit.
    pub predicted_decrease: f64,
    /// Postures tried, the first one among them.
    pub iterations: usize,
    /// Whether the predicted decrease is within the tolerance.
    pub converged: bool,
}

/// A minimizer with its memory, which it reuses at each call.
#[derive(Debug)]
pub struct Solver<'a> {
    pub(crate) evaluation: Evaluation<'a>,
    pub(crate) eliminator: Box<dyn LinearSolver>,
    pub(crate) pair_factors: PairFactors,
    pub(crate) state: State,
    pub(crate) trial: State,
    pub(crate) step: Vec<f64>,
    /// The Hessian times the step.
    pub(crate) product: Vec<f64>,
    pub(crate) right: Vec<f64>,
    pub(crate) damping: Vec<f64>,
    pub(crate) free: Vec<f64>,
    /// The held unknowns' part of the step.
    pub(crate) held: Vec<f64>,
}

impl<'a> Solver<'a> {
    /// Returns a minimizer for this hand.
    pub fn new(hand: &'a CompiledHand) -> Self {
        let n = hand.layout.n;
        let state = State {
            root: RootPose::identity(),
            q: vec![0.0; hand.dof()],
        };
        Self {
            evaluation: Evaluation::new(hand),
            eliminator: eliminator(&hand.layout),
            pair_factors: PairFactors::default(),
            trial: state.clone(),
            state,
            step: vec![0.0; n],
            product: vec![0.0; n],
            right: vec![0.0; n],
            damping: vec![0.0; n],
            free: vec![1.0; n],
            held: vec![0.0; n],
        }
    }

    /// Returns the hand.
    pub fn hand(&self) -> &'a CompiledHand {
        self.evaluation.hand
    }

    /// Returns the hand at its last placed posture: that of [`Solver::place`] or, after a search,
    /// of the last trial.
    pub fn posed(&self) -> Posed<'_> {
        self.evaluation.posed()
    }

    /// Places the hand at a posture, within its limits or not, and returns the cost there.
    ///
    /// # Errors
    ///
    /// Fails if the task or the posture does not fit the hand or is not finite.
    pub fn place<T: Terms>(
        &mut self,
        task: &Task<'_>,
        posture: &Posture,
        terms: &mut T,
    ) -> Result<f64, SolverError> {
        task.check(self.evaluation.hand)?;
        self.load(posture)?;
        let joints = &self.evaluation.hand.layout.joints;
        for (q, &joint) in self.state.q.iter_mut().zip(joints) {
            *q = posture.q[joint];
        }
        Ok(self.evaluation.cost(&self.state, task, terms))
    }

    /// Places the hand at a posture, within its limits or not, writes the cost's derivatives by the
    /// root's unknowns and then the joints in the model's order, and returns the cost.
    ///
    /// # Errors
    ///
    /// Fails if the task, the posture or the gradient's length does not fit the hand.
    pub fn gradient<T: Terms>(
        &mut self,
        task: &Task<'_>,
        posture: &Posture,
        terms: &mut T,
        gradient: &mut [f64],
    ) -> Result<f64, SolverError> {
        let cost = self.place(task, posture, terms)?;
        let evaluation = &mut self.evaluation;
        if gradient.len() != evaluation.gradient.len() {
            return Err(SolverError::WrongLength {
                what: "derivatives",
                found: gradient.len(),
                expected: evaluation.gradient.len(),
            });
        }
        evaluation.differentiate(&self.state, task, HessianForm::Exact);
        let layout = &evaluation.hand.layout;
        let (root, joints) = gradient.split_at_mut(layout.n_root);
        root.copy_from_slice(&evaluation.gradient[..layout.n_root]);
        for (slot, &joint) in layout.joints.iter().enumerate() {
            joints[joint] = evaluation.gradient[layout.n_root + slot];
        }
        Ok(cost)
    }

    /// Moves `posture` to a minimum of the task near it, with every joint within its limits from
    /// the first posture tried to the last.
    ///
    /// Each iteration minimizes the cost's expansion to second order over the box of limits by a
    /// primal-dual active set (Hintermüller, Ito and Kunisch, "The primal-dual active set strategy
    /// as a semismooth Newton method", 2003), damped where the expansion is not to be trusted
    /// (Nocedal and Wright, *Numerical Optimization*, 2006, §4 and §10.3). The expansion is exact
    /// where it has a minimum and Gauss-Newton's elsewhere.
    ///
    /// # Errors
    ///
    /// Fails if the task or the posture does not fit the hand or is not finite.
    pub fn minimize<T: Terms>(
        &mut self,
        task: &Task<'_>,
        posture: &mut Posture,
        options: &SearchOptions,
        terms: &mut T,
    ) -> Result<SearchOutcome, SolverError> {
        task.check(self.evaluation.hand)?;
        self.load(posture)?;
        let outcome = self.search(task, options, terms);
        posture.root = self.state.root;
        let joints = &self.evaluation.hand.layout.joints;
        for (&q, &joint) in self.state.q.iter().zip(joints) {
            posture.q[joint] = q;
        }
        Ok(outcome)
    }

    fn search<T: Terms>(
        &mut self,
        task: &Task<'_>,
        options: &SearchOptions,
        terms: &mut T,
    ) -> SearchOutcome {
        let mut cost = self.evaluation.cost(&self.state, task, terms);
        let mut form = HessianForm::Exact;
        self.evaluation.differentiate(&self.state, task, form);
        let mut damping = 0.0;
        // Whether the evaluation is that of the state, not of a trial that failed.
        let mut is_current = true;
        let mut outcome = SearchOutcome {
            cost,
            predicted_decrease: f64::INFINITY,
            iterations: 1,
            converged: false,
        };
        while outcome.iterations < options.max_iterations && damping < MAX_DAMPING {
            let Some(predicted) = self.bounded_step(damping, options.root_motion) else {
                if form == HessianForm::Exact {
                    if !is_current {
                        self.evaluation.cost(&self.state, task, terms);
                        is_current = true;
                    }
                    form = HessianForm::Convex;
                    self.evaluation.differentiate(&self.state, task, form);
                } else {
                    damping = (damping * 10.0).max(FIRST_DAMPING);
                }
                continue;
            };
            if damping == 0.0 {
                outcome.predicted_decrease = predicted;
            }
            if predicted <= options.relative_tolerance * cost + options.min_decrease {
                outcome.converged = damping <= 1.0;
                break;
            }
            self.make_trial();
            let trial_cost = self.evaluation.cost(&self.trial, task, terms);
            outcome.iterations += 1;
            let share = (cost - trial_cost) / predicted;
            if share > MIN_SHARE {
                std::mem::swap(&mut self.state, &mut self.trial);
                cost = trial_cost;
                outcome.cost = cost;
                is_current = true;
                if share < 0.25 {
                    damping = (damping * 4.0).max(FIRST_DAMPING);
                } else if share > 0.7 {
                    damping *= 0.1;
                    if damping < MIN_DAMPING {
                        damping = 0.0;
                    }
                }
                // Near the end the Hessian hardly changes, and the current one suffices.
                let is_near = form == HessianForm::Exact
                    && damping == 0.0
                    && (share - 1.0).abs() < SHARE_TOLERANCE;
                if is_near
                    && let Some(predicted_decrease) = self.remaining_decrease(task)
                    && predicted_decrease
                        <= options.relative_tolerance * cost + options.min_decrease
                {
                    outcome.predicted_decrease = predicted_decrease;
                    outcome.converged = true;
                    break;
                }
                form = HessianForm::Exact;
                self.evaluation.differentiate(&self.state, task, form);
            } else {
                is_current = false;
                damping = (damping * 8.0).max(FIRST_DAMPING);
            }
        }
        outcome
    }

    /// Takes a posture over, within limits.
    fn load(&mut self, posture: &Posture) -> Result<(), SolverError> {
        let hand = self.evaluation.hand;
        posture.check(hand.dof())?;
        self.state.root = posture.root;
        for (slot, &joint) in hand.layout.joints.iter().enumerate() {
            self.state.q[slot] = posture.q[joint].max(hand.lower[slot]).min(hand.upper[slot]);
        }
        Ok(())
    }

    /// Moves the trial to the state plus the step.
    fn make_trial(&mut self) {
        let hand = self.evaluation.hand;
        let n_root = hand.layout.n_root;
        let (root_step, joint_step) = self.step.split_at(n_root);
        self.trial.root = self.state.root;
        if let &[x, y, z, a, b, c] = root_step
            && self.free[0] > 0.0
        {
            let (along, turn) = (Vector3::new(x, y, z), Vector3::new(a, b, c));
            let root = &self.state.root;
            self.trial.root = match hand.root {
                Root::Angles => RootPose::from_angles(root.translation + along, root.angles + turn),
                Root::Free | Root::Fixed => root.turned(along, turn),
            };
        }
        for (slot, step) in joint_step.iter().enumerate() {
            self.trial.q[slot] = (self.state.q[slot] + step)
                .max(hand.lower[slot])
                .min(hand.upper[slot]);
        }
    }
}
