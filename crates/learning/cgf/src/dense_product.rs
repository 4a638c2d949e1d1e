//! Products of dense matrices, as an operation that candle differentiates.
//!
//! Every entry is one sum of fused products in the order of the inner index, so that it depends neither on the
//! width of registers nor on the number of threads. candle's own products split sums by the sizes of caches.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use candle_core::{CpuStorage, CustomOp2, Layout, Shape, Tensor};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Columns of the product that are worked on together.
const COLUMNS: usize = 32;

/// Rows of the product that one thread makes at a time.
const ROWS: usize = 24;

/// Returns the product of two matrices.
pub(crate) fn product(left: &Tensor, right: &Tensor) -> candle_core::Result<Tensor> {
    if left.device().is_cpu() {
        left.apply_op2(right, Product)
    } else {
        left.matmul(right)
    }
}

struct Product;

impl CustomOp2 for Product {
    fn name(&self) -> &'static str {
        "product"
    }

    fn cpu_fwd(
        &self,
        left: &CpuStorage,
        left_layout: &Layout,
        right: &CpuStorage,
        right_layout: &Layout,
    ) -> candle_core::Result<(CpuStorage, Shape)> {
        let left = Matrix::new(left, left_layout)?;
        let right = Matrix::new(right, right_layout)?;
        if left.columns != right.rows {
            let (columns, rows) = (left.columns, right.rows);
            candle_core::bail!("a matrix of {columns} columns times one of {rows} rows");
        }
        let mut out = vec![0.0; left.rows * right.columns];
        multiply(&left, &right, &mut out);
        let shape = Shape::from((left.rows, right.columns));
        Ok((CpuStorage::F32(out), shape))
    }

    fn bwd(
        &self,
        left: &Tensor,
        right: &Tensor,
        _: &Tensor,
        by: &Tensor,
    ) -> candle_core::Result<(Option<Tensor>, Option<Tensor>)> {
        let by_left = by.apply_op2_no_bwd(&right.t()?, &Self)?;
        let by_right = left.t()?.apply_op2_no_bwd(by, &Self)?;
        Ok((Some(by_left), Some(by_right)))
    }
}

/// A matrix with strides.
struct Matrix<'a> {
    numbers: &'a [f32],
    rows: usize,
    columns: usize,
    /// Distance in `numbers` from a row to the next, and from a column to the next.
    strides: [usize; 2],
}

impl<'a> Matrix<'a> {
    fn new(storage: &'a CpuStorage, layout: &Layout) -> candle_core::Result<Self> {
        let (rows, columns) = layout.shape().dims2()?;
        let strides = [layout.stride()[0], layout.stride()[1]];
        let numbers = &storage.as_slice::<f32>()?[layout.start_offset()..];
        Ok(Self {
            numbers,
            rows,
            columns,
            strides,
        })
    }

    fn at(&self, row: usize, column: usize) -> f32 {
        self.numbers[row * self.strides[0] + column * self.strides[1]]
    }

    /// Lays out so many columns side by side, group after group, row after row; zero where there is no column.
    fn panels(&self) -> Vec<[f32; COLUMNS]> {
        let mut panels = vec![[0.0; COLUMNS]; self.rows * self.columns.div_ceil(COLUMNS)];
        let chunks = panels.par_chunks_mut(self.rows).enumerate();
        chunks.for_each(|(panel, lines)| {
            let first = panel * COLUMNS;
            let n = COLUMNS.min(self.columns - first);
            if self.strides[1] == 1 {
                for (row, line) in lines.iter_mut().enumerate() {
                    let start = row * self.strides[0] + first;
                    line[..n].copy_from_slice(&self.numbers[start..start + n]);
                }
            } else {
                for column in 0..n {
                    for (row, line) in lines.iter_mut().enumerate() {
                        line[column] = self.at(row, first + column);
                    }
                }
            }
        });
        panels
    }
}

/// Sets `out`, row after row, to a product.
fn multiply(left: &Matrix, right: &Matrix, out: &mut [f32]) {
    if out.is_empty() || right.rows == 0 {
        return;
    }
    let panels = right.panels();
    let chunks = out.par_chunks_mut(ROWS * right.columns).enumerate();
    chunks.for_each(|(chunk, out)| {
        Arch::new().dispatch(Chunk {
            left,
            first: chunk * ROWS,
            panels: &panels,
            columns: right.columns,
            out,
        });
    });
}

/// Some rows of a product.
struct Chunk<'a> {
    left: &'a Matrix<'a>,
    first: usize,
    panels: &'a [[f32; COLUMNS]],
    columns: usize,
    out: &'a mut [f32],
}

impl WithSimd for Chunk<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Sums take three quarters of the registers: AVX-512 has 32, AVX2 has 16.
        match S::F32_LANES {
            16 => self.run::<S, 2, 12>(simd),
            8 => self.run::<S, 4, 3>(simd),
            4 => self.run::<S, 8, 1>(simd),
            _ => self.run::<S, COLUMNS, 1>(simd),
        }
    }
}

impl Chunk<'_> {
    /// Goes through the rows, `R` together, each in `V` registers.
    #[inline(always)]
    fn run<S: Simd, const V: usize, const R: usize>(self, simd: S) {
        let inner = self.left.columns;
        let mut factors = Vec::with_capacity(inner);
        for (block, out) in self.out.chunks_mut(R * self.columns).enumerate() {
            let first = self.first + block * R;
            let last = self.left.rows - 1;
            // Beyond the last row the last one is taken again, and left out below.
            factors.clear();
            factors.extend((0..inner).map(|k| -> [f32; R] {
                std::array::from_fn(|row| self.left.at((first + row).min(last), k))
            }));
            for (panel, right) in self.panels.chunks_exact(inner).enumerate() {
                let sums = tile::<S, V, R>(simd, &factors, right);
                let first = panel * COLUMNS;
                let n = COLUMNS.min(self.columns - first);
                for (out, sums) in out.chunks_exact_mut(self.columns).zip(&sums) {
                    let mut line = [0.0; COLUMNS];
                    let (registers, _) = S::as_mut_simd_f32s(&mut line);
                    registers.copy_from_slice(sums);
                    out[first..first + n].copy_from_slice(&line[..n]);
                }
            }
        }
    }
}

/// The products of some rows of the left matrix with a panel of the right one.
#[inline(always)]
fn tile<S: Simd, const V: usize, const R: usize>(
    simd: S,
    factors: &[[f32; R]],
    right: &[[f32; COLUMNS]],
) -> [[S::f32s; V]; R] {
    let mut sums = [[simd.splat_f32s(0.0); V]; R];
    for (factors, right) in factors.iter().zip(right) {
        let (right, _) = S::as_simd_f32s(right);
        for (sums, &factor) in sums.iter_mut().zip(factors) {
            let factor = simd.splat_f32s(factor);
            for (sum, &right) in sums.iter_mut().zip(right) {
                *sum = simd.mul_add_f32s(factor, right, *sum);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;
    use crate::random::Random;

    fn matrix(rows: usize, columns: usize, random: &mut Random) -> Var {
        let numbers: Vec<f32> = (0..rows * columns)
            .map(|_| random.normal() as f32)
            .collect();
        Var::from_vec(numbers, (rows, columns), &Device::Cpu).unwrap()
    }

    /// The product in registers of one width.
    fn multiplied_by(op: impl Fn(Chunk)) -> Vec<f32> {
        let mut random = Random::new(6, 0);
        let mut numbers =
            |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal() as f32).collect() };
        let (left, right) = (numbers(25 * 40), numbers(40 * 37));
        let matrix = |numbers, rows, columns| Matrix {
            numbers,
            rows,
            columns,
            strides: [columns, 1],
        };
        let (left, right) = (matrix(&left, 25, 40), matrix(&right, 40, 37));
        let mut out = vec![0.0; 25 * 37];
        let panels = right.panels();
        op(Chunk {
            left: &left,
            first: 0,
            panels: &panels,
            columns: 37,
            out: &mut out,
        });
        out
    }

    #[test]
    fn registers_of_any_width_give_the_same_bits() {
        let plain = multiplied_by(|chunk| chunk.with_simd(pulp::Scalar::new()));
        assert!(plain.iter().all(|sum| *sum != 0.0));
        assert_eq!(plain, multiplied_by(|chunk| Arch::new().dispatch(chunk)));
        #[cfg(target_arch = "x86_64")]
        if let Some(narrow) = pulp::x86::V3::try_new() {
            assert_eq!(plain, multiplied_by(|chunk| Simd::vectorize(narrow, chunk)));
        }
    }

    #[test]
    fn matrices_that_do_not_fit_and_empty_ones() {
        let mut random = Random::new(7, 0);
        let (left, right) = (matrix(2, 3, &mut random), matrix(2, 3, &mut random));
        let error = product(&left, &right).unwrap_err().to_string();
        assert!(error.contains("3 columns times one of 2 rows"), "{error}");
        let none = left.narrow(1, 0, 0).unwrap();
        let zeros = product(&none, &right.narrow(0, 0, 0).unwrap()).unwrap();
        assert_eq!(zeros.to_vec2::<f32>().unwrap(), [[0.0; 3]; 2]);
        let inner = left.narrow(1, 1, 2).unwrap();
        let [ours, theirs] = [product(&inner, &right), inner.matmul(&right)];
        let [ours, theirs] = [ours, theirs].map(|of| of.unwrap().to_vec2::<f32>().unwrap());
        for (ours, theirs) in ours.concat().into_iter().zip(theirs.concat()) {
            assert!((ours - theirs).abs() < 1e-6);
        }
    }

    #[test]
    fn every_entry_is_one_sum_in_order_and_gradients_are_candles() {
        let mut random = Random::new(5, 0);
        for (rows, inner, columns) in [(1, 1, 1), (25, 7, 33), (50, 40, 64), (3, 600, 5)] {
            let left = matrix(rows, inner, &mut random);
            let right = matrix(columns, inner, &mut random);
            let ours = product(&left, &right.t().unwrap()).unwrap();
            let [l, r] = [&left, &right].map(|of| of.to_vec2::<f32>().unwrap());
            for (l, ours) in l.iter().zip(ours.to_vec2::<f32>().unwrap()) {
                for (r, ours) in r.iter().zip(ours) {
                    let sum = l
                        .iter()
                        .zip(r)
                        .fold(0.0_f32, |sum, (l, r)| l.mul_add(*r, sum));
                    assert_eq!(sum, ours, "{rows} {inner} {columns}");
                }
            }
            let theirs = left.matmul(&right.t().unwrap()).unwrap();
            let [ours, theirs] = [ours, theirs].map(|of| of.sqr().unwrap().backward().unwrap());
            for of in [&left, &right] {
                let [ours, theirs] =
                    [&ours, &theirs].map(|by| by.get(of).unwrap().flatten_all().unwrap());
                let size = theirs.abs().unwrap().max(0).unwrap();
                let off = (ours - theirs).unwrap().abs().unwrap().max(0).unwrap();
                let off: f32 = off.to_scalar().unwrap();
                let size: f32 = size.to_scalar().unwrap();
                assert!(off < 1e-5 * size, "{off} of {size}");
            }
        }
    }
}
