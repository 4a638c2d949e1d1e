//! Products of dense matrices, as an operation that candle differentiates.
//!
//! Sixteen rows of the left matrix are a patch of [`project`]. Every entry is one sum in the order of the inner index,
//! so that it depends neither on the width of registers nor on the number of threads. Factors that are zero in all
//! sixteen rows are left out, which changes no sum of finite numbers. candle's own products split sums by the sizes of
//! caches.

use candle_core::{CpuStorage, CustomOp2, Layout, Shape, Tensor};
use rayon::prelude::*;

use crate::product::{LANES, PackedMatrix, Sparse, project};

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
}

/// Sets `out`, row after row, to a product.
fn multiply(left: &Matrix, right: &Matrix, out: &mut [f32]) {
    if out.is_empty() || right.rows == 0 {
        return;
    }
    let weights = PackedMatrix::new(right.columns, right.rows, |column, inner| {
        right.at(inner, column)
    });
    let offset = vec![0.0; right.columns];
    let patches = out.par_chunks_mut(LANES * right.columns).enumerate();
    patches.for_each_init(
        || (Sparse::default(), Vec::new(), Vec::new()),
        |(patch, rows, sums), (number, out)| {
            let first = number * LANES;
            let n = LANES.min(left.rows - first);
            rows.clear();
            rows.resize(left.columns, [0.0; LANES]);
            for lane in 0..n {
                for (column, row) in rows.iter_mut().enumerate() {
                    row[lane] = left.at(first + lane, column);
                }
            }
            patch.take(rows);
            sums.resize(right.columns, [0.0; LANES]);
            project(&weights, std::slice::from_ref(patch), &offset, sums);
            for (lane, out) in out.chunks_exact_mut(right.columns).enumerate() {
                for (out, sums) in out.iter_mut().zip(&*sums) {
                    *out = sums[lane];
                }
            }
        },
    );
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
            // As behind `max(x, 0)`: half of the factors are zero, and of three rows often all.
            if rows > 1 {
                left.set(&left.relu().unwrap()).unwrap();
            }
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
