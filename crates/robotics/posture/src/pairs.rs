//! Residuals between two links: their slopes, and their second derivatives beside the arrow.
//!
//! A pair couples the joints of two fingers, and these second derivatives have no place in the arrow. They are
//! Gauss-Newton's, a sum of `c g gᵀ` over the pairs, so few systems with the arrow's factors solve the whole one
//! (Woodbury's formula; Golub and Van Loan, *Matrix Computations*, 2013, §2.1.4).

use crate::{arrow::LinearSolver, evaluate::Evaluation, layout::Layout, task::PairResidual};

/// Second derivatives of the residuals of pairs.
#[derive(Debug, Default)]
pub(crate) struct PairRows {
    /// The factors `c`.
    curvatures: Vec<f64>,
    /// The rows `g`, `(pair, unknown)`.
    rows: Vec<f64>,
    /// Numbers in a row.
    n: usize,
}

/// What remains of a solution for the next right side, and memory.
#[derive(Debug, Default)]
pub(crate) struct PairFactors {
    /// Solutions of the arrow for the rows, `(pair, unknown)`.
    solved: Vec<f64>,
    /// Lower Cholesky factor of `1/c + gᵀ A⁻¹ g`, `(pair, pair)`.
    factor: Vec<f64>,
    /// One number for each pair.
    shares: Vec<f64>,
}

impl Evaluation<'_> {
    /// Adds the slopes of the residuals of pairs to the gradient.
    pub(crate) fn pair_slopes(&mut self) {
        for idx in 0..self.pair_residuals.len() {
            let residual = self.pair_residuals[idx];
            let slope = 2.0 * residual.weight * residual.weight * residual.residual;
            self.each_rate(&residual, |evaluation, unknown, rate| {
                evaluation.gradient[unknown] += slope * rate;
            });
        }
    }

    /// Computes the rows of the residuals of pairs.
    pub(crate) fn pair_rows(&mut self) {
        let n = self.hand.layout.n;
        self.pairs.curvatures.clear();
        self.pairs.rows.clear();
        self.pairs.n = n;
        for idx in 0..self.pair_residuals.len() {
            let residual = self.pair_residuals[idx];
            if residual.weight == 0.0 {
                continue;
            }
            let first = self.pairs.rows.len();
            self.pairs.rows.resize(first + n, 0.0);
            let curvature = 2.0 * residual.weight * residual.weight;
            self.pairs.curvatures.push(curvature);
            self.each_rate(&residual, |evaluation, unknown, rate| {
                evaluation.pairs.rows[first + unknown] += rate;
            });
        }
    }

    /// Calls `add` with each unknown that moves the links against each other, and the residual's rate by it; more than
    /// once for a joint that moves several bodies.
    fn each_rate(&mut self, residual: &PairResidual, add: impl Fn(&mut Self, usize, f64)) {
        let hand = self.hand;
        let [Some(a), Some(b)] = residual.links.map(|link| hand.links.get(link)) else {
            return;
        };
        let [mut a, mut b] = [a.body, b.body];
        let [at_a, at_b] = residual
            .points_in_object
            .map(|point| point.coords - self.root.translation);
        // Parents have the smaller numbers; what is above both moves them alike.
        while a != b {
            let (idx, at, sign) = if a > b {
                (a, at_a, -1.0)
            } else {
                (b, at_b, 1.0)
            };
            let body = &hand.bodies[idx];
            let twist = self.frames[idx].twist(body.is_prismatic);
            let velocity = twist.linear + twist.angular.cross(&at);
            let rate = sign * body.multiplier * residual.gradient_in_object.dot(&velocity);
            add(self, hand.layout.unknowns[idx], rate);
            *(if a > b { &mut a } else { &mut b }) = body.parent;
        }
    }
}

impl PairRows {
    pub(crate) fn is_empty(&self) -> bool {
        self.curvatures.is_empty()
    }

    /// Returns the factors and the rows.
    fn each(&self) -> impl Iterator<Item = (f64, &[f64])> {
        let rows = self.rows.chunks_exact(self.n.max(1));
        self.curvatures.iter().copied().zip(rows)
    }

    /// Returns the second derivative by an unknown.
    pub(crate) fn diagonal(&self, unknown: usize) -> f64 {
        self.each().map(|(c, row)| c * row[unknown].powi(2)).sum()
    }

    /// Adds the matrix times a vector to `product`.
    pub(crate) fn add_product(&self, vector: &[f64], product: &mut [f64]) {
        for (curvature, row) in self.each() {
            let factor = curvature * dot(row, vector);
            for (product, rate) in product.iter_mut().zip(row) {
                *product += factor * rate;
            }
        }
    }

    /// Returns one element of the matrix times a vector.
    pub(crate) fn product_at(&self, vector: &[f64], unknown: usize) -> f64 {
        let parts = self.each();
        parts
            .map(|(c, row)| c * row[unknown] * dot(row, vector))
            .sum()
    }
}

impl PairFactors {
    /// Prepares corrections of solutions of the arrow that was eliminated last, with its unknowns held.
    ///
    /// Returns false if rounding left the matrix not positive definite.
    pub(crate) fn prepare(
        &mut self,
        pairs: &PairRows,
        eliminator: &mut dyn LinearSolver,
        layout: &Layout,
        free: &[f64],
    ) -> bool {
        let (n, n_pairs) = (pairs.n, pairs.curvatures.len());
        self.shares.clear();
        if n_pairs == 0 {
            return true;
        }
        self.solved.resize(n_pairs * n, 0.0);
        self.factor.resize(n_pairs * n_pairs, 0.0);
        self.shares.resize(n_pairs, 0.0);
        for ((_, row), solved) in pairs.each().zip(self.solved.chunks_exact_mut(n)) {
            eliminator.solve_again(layout, row, free, solved);
        }
        for (i, (curvature, row)) in pairs.each().enumerate() {
            for (j, solved) in self.solved.chunks_exact(n).enumerate().take(i + 1) {
                let of_curvature = if i == j { 1.0 / curvature } else { 0.0 };
                self.factor[i * n_pairs + j] = of_curvature + dot(row, solved);
            }
        }
        for i in 0..n_pairs {
            for j in 0..=i {
                let (above, row) = self.factor.split_at_mut(i * n_pairs);
                let of_j = if j < i {
                    &above[j * n_pairs..]
                } else {
                    &row[..]
                };
                let rest = row[j] - dot(&row[..j], &of_j[..j]);
                row[j] = if j < i {
                    rest / of_j[j]
                } else if rest > 0.0 {
                    rest.sqrt()
                } else {
                    return false;
                };
            }
        }
        true
    }

    /// Corrects a solution of the arrow to one of the arrow with the pairs prepared last.
    pub(crate) fn correct(&mut self, pairs: &PairRows, step: &mut [f64]) {
        let n_pairs = self.shares.len();
        if n_pairs == 0 {
            return;
        }
        for (i, (_, row)) in pairs.each().enumerate() {
            let of_row = &self.factor[i * n_pairs..];
            let rest = dot(row, step) - dot(&of_row[..i], &self.shares[..i]);
            self.shares[i] = rest / of_row[i];
        }
        for i in (0..n_pairs).rev() {
            let below = (i + 1..n_pairs).map(|j| self.factor[j * n_pairs + i] * self.shares[j]);
            self.shares[i] = (self.shares[i] - below.sum::<f64>()) / self.factor[i * n_pairs + i];
        }
        for (share, solved) in self.shares.iter().zip(self.solved.chunks_exact(pairs.n)) {
            for (step, solved) in step.iter_mut().zip(solved) {
                *step -= share * solved;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
