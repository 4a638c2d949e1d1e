//! Means and covariances of channels over many points, put together from those of parts.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use super::kernel::{Pairs, correlate, sum_of};
use crate::{
    precision::narrow,
    product::{LANES, Row},
};

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
    pub(super) fn measure(panel: &[Row], width: usize, n: usize, scratch: &mut Scratch) -> Self {
        let mut mean = vec![0.0; width];
        scratch.centered.resize(panel.len(), [0.0; LANES]);
        Arch::new().dispatch(Center {
            panel,
            n,
            mean: &mut mean,
            centered: &mut scratch.centered,
        });
        scratch.products.resize(width * width, 0.0);
        let (centered, patches) = (&scratch.centered, panel.len() / width);
        correlate(
            centered,
            centered,
            patches,
            Pairs::Upper,
            &mut scratch.products,
        );
        let mut scatter = vec![0.0; width * width];
        for i in 0..width {
            for j in i..width {
                let product = f64::from(scratch.products[i * width + j]);
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

    /// Takes in the moments of further rows (Chan, Golub and `LeVeque`, *Updating formulae and a pairwise
    /// algorithm for computing sample variances*, 1979, eq. 2.1).
    pub(super) fn add(&mut self, other: &Self) {
        if self.n == 0.0 {
            *self = other.clone();
            return;
        }
        let n = self.n + other.n;
        let apart: Vec<f64> = other
            .mean
            .iter()
            .zip(&self.mean)
            .map(|(b, a)| b - a)
            .collect();
        let factor = self.n * other.n / n;
        Arch::new().dispatch(Add {
            scatter: &mut self.scatter,
            other: &other.scatter,
            apart: &apart,
            factor,
        });
        for (mean, apart) in self.mean.iter_mut().zip(&apart) {
            *mean += apart * other.n / n;
        }
        self.n = n;
    }

    /// Returns mean `w · mean` and variance `w · Cov w` of the product with a weight, and `Cov w`.
    pub(super) fn of_product(&self, weight: &[f32]) -> (f64, f64, Vec<f64>) {
        let mean = self
            .mean
            .iter()
            .zip(weight)
            .map(|(m, &w)| m * f64::from(w))
            .sum();
        let mut by = vec![0.0; weight.len()];
        for (row, &w) in self.scatter.chunks_exact(weight.len()).zip(weight) {
            Arch::new().dispatch(Axpy {
                factor: f64::from(w) / self.n,
                x: row,
                sums: &mut by,
            });
        }
        let variance: f64 = by.iter().zip(weight).map(|(b, &w)| b * f64::from(w)).sum();
        (mean, variance.max(0.0), by)
    }
}

/// `scatter += other + factor apart apartᵀ`.
struct Add<'a> {
    scatter: &'a mut [f64],
    other: &'a [f64],
    apart: &'a [f64],
    factor: f64,
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let width = self.apart.len();
        let rows = self.scatter.chunks_exact_mut(width);
        for ((row, added), a) in rows.zip(self.other.chunks_exact(width)).zip(self.apart) {
            let factor = self.factor * a;
            for ((x, added), b) in row.iter_mut().zip(added).zip(self.apart) {
                *x += added + factor * b;
            }
        }
    }
}

/// `sums += factor x`.
pub(super) struct Axpy<'a> {
    pub(super) factor: f64,
    pub(super) x: &'a [f64],
    pub(super) sums: &'a mut [f64],
}

impl WithSimd for Axpy<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (sum, x) in self.sums.iter_mut().zip(self.x) {
            *sum += self.factor * x;
        }
    }
}

/// Room for intermediate results that is used again and again.
#[derive(Default)]
pub(super) struct Scratch {
    centered: Vec<Row>,
    products: Vec<f32>,
}

/// Measures the mean of each channel over the first `n` points of a panel, and sets `centered` to the
/// differences from it, channel after channel; what is beyond the `n` points is zero.
struct Center<'a> {
    panel: &'a [Row],
    n: usize,
    mean: &'a mut [f64],
    centered: &'a mut [Row],
}

impl WithSimd for Center<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            panel,
            n,
            mean,
            centered,
        } = self;
        let width = mean.len();
        let patches = panel.len() / width;
        let channels = centered.chunks_exact_mut(patches).zip(mean).enumerate();
        for (channel, (centered, mean)) in channels {
            let rows = panel.iter().skip(channel).step_by(width);
            for (centered, row) in centered.iter_mut().zip(rows) {
                *centered = *row;
            }
            centered.as_flattened_mut()[n..].fill(0.0);
            let mut sums = [0.0; LANES];
            for row in &*centered {
                for (sum, x) in sums.iter_mut().zip(row) {
                    *sum += x;
                }
            }
            *mean = f64::from(sum_of(&sums)) / n as f64;
            let mean = simd.splat_f32s(narrow(*mean));
            let (values, _) = S::as_mut_simd_f32s(centered.as_flattened_mut());
            for value in values {
                *value = simd.sub_f32s(*value, mean);
            }
            centered.as_flattened_mut()[n..].fill(0.0);
        }
    }
}

/// Sets what fills up a patch of fewer than sixteen points to zero.
#[inline(always)]
pub(super) fn clear_beyond(rows: &mut [Row], n: usize) {
    if n < LANES {
        for row in rows {
            row[n..].fill(0.0);
        }
    }
}
