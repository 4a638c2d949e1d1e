//! Means and covariances of channels over many points, put together from those of parts.

use pulp::Arch;

use super::kernel::{LANES, Pairs, Row, correlate};
use crate::precision::narrow;

/// Number, mean and scatter matrix `Σ (x − mean)(x − mean)ᵀ` of rows of numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct Moments {
    pub(super) n: f64,
    pub(super) mean: Vec<f64>,
    /// `(width, width)`, symmetric.
    pub(super) scatter: Vec<f64>,
}

impl Moments {
    /// Measures the first `n` points of a panel of `width` channels. `f32` carries the products of
    /// differences from the panel's own mean, `f64` everything else.
    pub(super) fn measure(panel: &[Row], width: usize, n: usize, room: &mut Room) -> Self {
        let mut mean = vec![0.0; width];
        for (patch, rows) in panel.chunks_exact(width).enumerate() {
            add_sums(rows, n - patch * LANES, &mut mean);
        }
        for mean in &mut mean {
            *mean /= n as f64;
        }
        room.centered.clear();
        room.centered.extend_from_slice(panel);
        for (patch, rows) in room.centered.chunks_exact_mut(width).enumerate() {
            subtract(rows, &mean);
            clear_beyond(rows, n - patch * LANES);
        }
        room.products.resize(width * width, 0.0);
        let centered = (room.centered.as_slice(), width);
        correlate(centered, centered, Pairs::Upper, &mut room.products);
        let mut scatter = vec![0.0; width * width];
        for i in 0..width {
            for j in i..width {
                let product = f64::from(room.products[i * width + j]);
                scatter[i * width + j] = product;
                scatter[j * width + i] = product;
            }
        }
        Self {
            n: n as f64,
            mean,
            scatter,
        }
    }

    /// Takes in the moments of further rows (Chan, Golub and LeVeque, *Updating formulae and a pairwise
    /// algorithm for computing sample variances*, 1979, eq. 2.1).
    pub(super) fn add(&mut self, other: &Self) {
        if self.n == 0.0 {
            *self = other.clone();
            return;
        }
        let n = self.n + other.n;
        let apart: Vec<f64> = other.mean.iter().zip(&self.mean).map(|(b, a)| b - a).collect();
        let factor = self.n * other.n / n;
        Arch::new().dispatch(|| {
            let width = apart.len();
            let rows = self.scatter.chunks_exact_mut(width);
            for ((row, added), a) in rows.zip(other.scatter.chunks_exact(width)).zip(&apart) {
                for ((x, added), b) in row.iter_mut().zip(added).zip(&apart) {
                    *x += added + factor * a * b;
                }
            }
        });
        for (mean, apart) in self.mean.iter_mut().zip(&apart) {
            *mean += apart * other.n / n;
        }
        self.n = n;
    }

    /// Returns mean `w · mean` and variance `w · Cov w` of the product with a weight, and `Cov w`.
    pub(super) fn of_product(&self, weight: &[f32]) -> (f64, f64, Vec<f64>) {
        let mean = self.mean.iter().zip(weight).map(|(m, &w)| m * f64::from(w)).sum();
        let mut by = vec![0.0; weight.len()];
        Arch::new().dispatch(|| {
            for (row, &w) in self.scatter.chunks_exact(weight.len()).zip(weight) {
                let w = f64::from(w) / self.n;
                for (by, x) in by.iter_mut().zip(row) {
                    *by += w * x;
                }
            }
        });
        let variance: f64 = by.iter().zip(weight).map(|(b, &w)| b * f64::from(w)).sum();
        (mean, variance.max(0.0), by)
    }
}

/// Room for intermediate results that is used again and again.
#[derive(Default)]
pub(super) struct Room {
    centered: Vec<Row>,
    products: Vec<f32>,
}

/// Adds each channel's sum over the first `n` points of a patch.
pub(super) fn add_sums(rows: &[Row], n: usize, sums: &mut [f64]) {
    for (row, sum) in rows.iter().zip(sums) {
        *sum += f64::from(sum_of(row, n));
    }
}

/// Sums the first `n` of a row, in pairs.
pub(super) fn sum_of(row: &Row, n: usize) -> f32 {
    if n < LANES {
        return row[..n].iter().sum();
    }
    let mut eight: [f32; 8] = std::array::from_fn(|k| row[k] + row[k + 8]);
    for half in [4, 2, 1] {
        for k in 0..half {
            eight[k] += eight[k + half];
        }
    }
    eight[0]
}

fn subtract(rows: &mut [Row], mean: &[f64]) {
    for (row, &mean) in rows.iter_mut().zip(mean) {
        let mean = narrow(mean);
        for x in row {
            *x -= mean;
        }
    }
}

/// Sets what fills up a patch of fewer than sixteen points to zero.
pub(super) fn clear_beyond(rows: &mut [Row], n: usize) {
    if n < LANES {
        for row in rows {
            row[n..].fill(0.0);
        }
    }
}
