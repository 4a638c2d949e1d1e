//! A step within joint limits.

#![expect(
    clippy::needless_range_loop,
    reason = "one index runs over many vectors of one length"
)]

use crate::{
    arrow::System,
    minimize::{RootMotion, Solver},
    task::Task,
};

/// Added to every diagonal element, relative to the largest one: keeps what nothing has a say in,
/// such as a turn of the wrist against one of a free root, where it is.
const FLOOR: f64 = 1e-12;
/// Share of that which every pivot must keep for the matrix to count as positive definite.
const MIN_PIVOT: f64 = 0.1;
/// Maximum number of passes in the search for the active limits.
const MAX_PASSES: usize = 12;

impl Solver<'_> {
    /// Computes the step to the minimum of the damped expansion within the limits, and returns the
    /// decrease that the undamped one predicts; `None` if there is no such minimum.
    pub(crate) fn bounded_step(&mut self, damping: f64, root_motion: RootMotion) -> Option<f64> {
        let floor = self.hold(damping, root_motion);
        let hand = self.evaluation.hand;
        let layout = &hand.layout;
        let (n, n_root) = (layout.n, layout.n_root);
        let hessian = &self.evaluation.hessian;
        let gradient = &self.evaluation.gradient;
        let pairs = &self.evaluation.pairs;
        // Whether some unknown is held away from where it is.
        let mut is_shifted = false;
        for pass in 0..MAX_PASSES {
            let system = System {
                layout,
                hessian,
                right: &self.right,
                damping: &self.damping,
                free: &self.free,
                least_pivot: MIN_PIVOT * floor,
            };
            if !self.eliminator.solve(&system, &mut self.step) {
                return None;
            }
            let (factors, eliminator) = (&mut self.pair_factors, &mut *self.eliminator);
            if !factors.prepare(pairs, eliminator, layout, &self.free) {
                return None;
            }
            factors.correct(pairs, &mut self.step);
            if is_shifted {
                for u in n_root..n {
                    self.step[u] += self.held[u];
                }
            }
            let mut changed = false;
            for u in n_root..n {
                let slot = u - n_root;
                let q = self.state.q[slot];
                let (below, above) = (hand.lower[slot] - q, hand.upper[slot] - q);
                if self.free[u] > 0.0 {
                    if self.step[u] < below || self.step[u] > above {
                        self.free[u] = 0.0;
                        self.held[u] = self.step[u].max(below).min(above);
                        changed = true;
                    }
                } else if pass + 2 < MAX_PASSES {
                    // Held only as long as it would leave otherwise.
                    let slope = gradient[u]
                        + layout.product_at(hessian, &self.step, u)
                        + pairs.product_at(&self.step, u);
                    let would_leave = (self.held[u] <= below && slope >= 0.0)
                        || (self.held[u] >= above && slope <= 0.0);
                    if !would_leave {
                        self.free[u] = 1.0;
                        self.held[u] = 0.0;
                        changed = true;
                    }
                }
            }
            if !changed {
                break;
            }
            is_shifted = self.held.iter().any(|&held| held != 0.0);
            if is_shifted {
                layout.product(hessian, &self.held, &mut self.product);
                pairs.add_product(&self.held, &mut self.product);
            } else {
                self.product.fill(0.0);
            }
            for u in 0..n {
                self.right[u] = -gradient[u] - self.product[u];
            }
        }
        let predicted = self.predicted_decrease(is_shifted);
        // NaN is not a prediction either.
        (predicted >= 0.0 && predicted.is_finite()).then_some(predicted)
    }

    /// Returns the decrease that the undamped expansion predicts for the step; `is_shifted` says whether
    /// some unknown is held away from where it is.
    fn predicted_decrease(&mut self, is_shifted: bool) -> f64 {
        let layout = &self.evaluation.hand.layout;
        let gradient = &self.evaluation.gradient;
        let mut predicted = 0.0;
        if is_shifted {
            layout.product(&self.evaluation.hessian, &self.step, &mut self.product);
            self.evaluation
                .pairs
                .add_product(&self.step, &mut self.product);
            for u in 0..layout.n {
                predicted -= self.step[u] * (gradient[u] + 0.5 * self.product[u]);
            }
        } else {
            // The damped matrix times the step is minus the gradient, or the step is 0.
            for u in 0..layout.n {
                predicted -= 0.5 * self.step[u] * (gradient[u] - self.damping[u] * self.step[u]);
            }
        }
        predicted
    }

    /// Holds the unknowns that would leave their limits at once, or nothing has a say in, and returns
    /// what is added to every diagonal element.
    fn hold(&mut self, damping: f64, root_motion: RootMotion) -> f64 {
        let hand = self.evaluation.hand;
        let layout = &hand.layout;
        let hessian = &self.evaluation.hessian;
        let largest = layout
            .diagonal
            .iter()
            .fold(0.0, |most: f64, &place| most.max(hessian[place]));
        let floor = FLOOR * largest;
        for u in 0..layout.n {
            let slope = self.evaluation.gradient[u];
            let mut curvature = self.evaluation.hessian[layout.diagonal[u]];
            if !self.evaluation.pairs.is_empty() {
                curvature += self.evaluation.pairs.diagonal(u);
            }
            self.damping[u] = damping * (curvature.abs() + floor) + floor;
            self.held[u] = 0.0;
            self.right[u] = -slope;
            let is_held = match u.checked_sub(layout.n_root) {
                None => root_motion == RootMotion::Fixed,
                Some(slot) => {
                    let q = self.state.q[slot];
                    (q <= hand.lower[slot] && slope > 0.0)
                        || (q >= hand.upper[slot] && slope < 0.0)
                        || (curvature == 0.0 && slope == 0.0)
                }
            };
            self.free[u] = if is_held { 0.0 } else { 1.0 };
        }
        floor
    }

    /// Returns the decrease predicted at a new state, by its own gradient and the Hessian of the
    /// state before, with what was held there; `None` if some of that is to be let go.
    pub(crate) fn remaining_decrease(&mut self, task: &Task<'_>) -> Option<f64> {
        self.evaluation.slopes(&self.state, task);
        let hand = self.evaluation.hand;
        let layout = &hand.layout;
        let gradient = &self.evaluation.gradient;
        for u in 0..layout.n {
            self.right[u] = -gradient[u];
            if u >= layout.n_root && self.free[u] == 0.0 {
                let slot = u - layout.n_root;
                let q = self.state.q[slot];
                let stays = (q <= hand.lower[slot] && gradient[u] >= 0.0)
                    || (q >= hand.upper[slot] && gradient[u] <= 0.0)
                    || gradient[u] == 0.0;
                if !stays {
                    return None;
                }
            }
        }
        let (free, step) = (&self.free, &mut self.step);
        self.eliminator.solve_again(layout, &self.right, free, step);
        self.pair_factors.correct(&self.evaluation.pairs, step);
        let gained: f64 = step
            .iter()
            .zip(&self.right)
            .map(|(step, right)| step * right)
            .sum();
        Some(0.5 * gained)
    }
}
