//! The cross-entropy method: draws about a mean, and moves the mean to the best draws.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Parameters of the cross-entropy method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossEntropy {
    /// Draws of one iteration.
    pub population: usize,
    /// Number of best draws that make the next mean and deviation.
    pub elites: usize,
    /// Iterations.
    pub iterations: usize,
    /// Standard deviation of the first draws, as a share of half the range of a number.
    pub initial_sd: f64,
    /// Least standard deviation, likewise.
    pub min_sd: f64,
    /// Share of the former mean and deviation in the next ones.
    pub smoothing: f64,
}

impl CrossEntropy {
    /// Returns the mean to which a first mean goes while `cost` is minimized over numbers from −1 to 1; beyond
    /// these, draws are put back to them. A cost that is no number is the worst.
    pub(crate) fn minimize(
        &self,
        mean: Vec<f64>,
        mut cost: impl FnMut(&[f64]) -> f64,
        rng: &mut impl Rng,
    ) -> Vec<f64> {
        let mut mean = mean;
        let mut sd = vec![self.initial_sd; mean.len()];
        for _ in 0..self.iterations {
            let mut drawn: Vec<(f64, Vec<f64>)> = Vec::with_capacity(self.population);
            for _ in 0..self.population {
                let draw: Vec<f64> = mean
                    .iter()
                    .zip(&sd)
                    .map(|(mean, sd)| {
                        let normal: f64 = StandardNormal.sample(rng);
                        (mean + sd * normal).clamp(-1.0, 1.0)
                    })
                    .collect();
                let cost = cost(&draw);
                let cost = if cost.is_nan() { f64::INFINITY } else { cost };
                drawn.push((cost, draw));
            }
            // Stable: of equal costs the first draw is the better one.
            drawn.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            drawn.truncate(self.elites);
            let n = drawn.len() as f64;
            for (idx, (mean, sd)) in mean.iter_mut().zip(&mut sd).enumerate() {
                let at = || drawn.iter().map(|(_, draw)| draw[idx]);
                let elite_mean = at().sum::<f64>() / n;
                let variance = at().map(|x| (x - elite_mean).powi(2)).sum::<f64>() / n;
                let blend =
                    |old: f64, new: f64| self.smoothing * old + (1.0 - self.smoothing) * new;
                *mean = blend(*mean, elite_mean);
                *sd = blend(*sd, variance.sqrt()).max(self.min_sd);
            }
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const METHOD: CrossEntropy = CrossEntropy {
        population: 100,
        elites: 10,
        iterations: 30,
        initial_sd: 0.5,
        min_sd: 1e-3,
        smoothing: 0.1,
    };

    /// Minimizes a quadratic with unequal axes about an optimum.
    fn quadratic(method: &CrossEntropy, optimum: [f64; 4]) -> (Vec<f64>, usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut evaluations_n = 0;
        let cost = |x: &[f64]| {
            evaluations_n += 1;
            let [a, b, c, d] = [0, 1, 2, 3].map(|idx: usize| x[idx] - optimum[idx]);
            a * a + 4.0 * b * b + 0.5 * (c - a) * (c - a) + 2.0 * d * d
        };
        let found = method.minimize(vec![0.0; 4], cost, &mut rng);
        (found, evaluations_n)
    }

    #[test]
    fn the_optimum_of_a_quadratic_is_found() {
        let optimum = [0.3, -0.7, 0.1, 0.55];
        let (found, evaluations_n) = quadratic(&METHOD, optimum);
        assert_eq!(evaluations_n, 3000);
        for (found, expected) in found.iter().zip(optimum) {
            assert!((found - expected).abs() < 0.01, "{found} {expected}");
        }
    }

    #[test]
    fn an_optimum_out_of_bounds_is_found_at_the_bound() {
        let (found, _) = quadratic(&METHOD, [0.0, 3.0, 0.0, 0.0]);
        assert!(found[1] > 0.98 && found[1] <= 1.0, "{found:?}");
    }

    #[test]
    fn two_iterations_already_come_nearer() {
        let optimum = [0.6, -0.6, 0.6, -0.6];
        let two = CrossEntropy {
            iterations: 2,
            ..METHOD
        };
        let (found, _) = quadratic(&two, optimum);
        let off = |x: &[f64]| {
            let squares = x.iter().zip(optimum).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f64>().sqrt()
        };
        assert!(off(&found) < 0.5 * off(&[0.0; 4]), "{found:?}");
    }

    #[test]
    fn costs_that_are_no_numbers_are_the_worst() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let cost = |x: &[f64]| {
            if x[0] > 0.0 {
                f64::NAN
            } else {
                (x[0] + 0.4).powi(2)
            }
        };
        let found = METHOD.minimize(vec![0.5], cost, &mut rng);
        assert!((found[0] + 0.4).abs() < 0.02, "{found:?}");
    }
}
