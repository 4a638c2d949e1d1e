//! Products of matrices with sixteen rows side by side, in the widest registers that the processor has.
//!
//! A row is a point of a cloud, a hand at a time of a motion, or a row of a matrix in training. What is zero at all
//! sixteen is left out: behind `max(x, 0)` neighbors are mostly zero together, about half of the time.
//! Every sum is made by the same operations in the same order wherever it stands, so that results do
//! not depend on how the work is divided.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use std::ops::{AddAssign, Mul};

use pulp::{Arch, Simd, WithSimd};

/// Rows that are worked on together: a *patch*.
pub(crate) const LANES: usize = 16;

/// One channel of a patch.
pub(crate) type Row<T = f32> = [T; LANES];

/// Outputs whose sums are kept in registers together: with sixteen rows, twelve of the sixteen
/// registers of eight numbers that most processors have. Where a register holds sixteen numbers there are
/// twice as many of them, and four groups are worked on together.
const GROUP: usize = 6;

/// A matrix laid out for products with patches.
#[derive(Debug, Clone)]
pub(crate) struct PackedMatrix<T = f32> {
    inputs: usize,
    outputs: usize,
    /// For each group of outputs and each input, the group's entries; zero where there is no output.
    groups: Vec<[T; GROUP]>,
}

impl<T: Copy + Default> PackedMatrix<T> {
    /// Returns the number of its inputs.
    pub(crate) fn inputs(&self) -> usize {
        self.inputs
    }

    /// Lays out a matrix of `outputs` rows, given by its entries at (output, input).
    pub(crate) fn new(outputs: usize, inputs: usize, entry: impl Fn(usize, usize) -> T) -> Self {
        let mut groups = Vec::with_capacity(outputs.div_ceil(GROUP) * inputs);
        for first in (0..outputs).step_by(GROUP) {
            groups.extend((0..inputs).map(|input| {
                std::array::from_fn(|k| {
                    let output = first + k;
                    if output < outputs {
                        entry(output, input)
                    } else {
                        T::default()
                    }
                })
            }));
        }
        Self {
            inputs,
            outputs,
            groups,
        }
    }
}

/// The channels of a patch that are not zero in all its rows. What is left out adds nothing: results are
/// the same to the bit.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sparse<T = f32> {
    rows: Vec<Row<T>>,
    at: Vec<u32>,
}

impl<T> Sparse<T> {
    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.at.clear();
    }

    /// Adds a channel with a number greater than all before.
    #[inline(always)]
    pub(crate) fn push(&mut self, channel: u32, row: Row<T>) {
        self.rows.push(row);
        self.at.push(channel);
    }
}

impl Sparse {
    /// Takes the channels of a patch.
    pub(crate) fn take(&mut self, rows: &[Row]) {
        Arch::new().dispatch(Take { sparse: self, rows });
    }
}

/// Whether all numbers are zero: all bits but the sign's, so that they are looked at together.
#[inline(always)]
pub(crate) fn are_zero(numbers: &[f32]) -> bool {
    numbers.iter().fold(0, |bits, x| bits | (x.to_bits() << 1)) == 0
}

struct Take<'a> {
    sparse: &'a mut Sparse,
    rows: &'a [Row],
}

impl WithSimd for Take<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.sparse.clear();
        for (k, row) in (0_u32..).zip(self.rows) {
            if !are_zero(row) {
                self.sparse.push(k, *row);
            }
        }
    }
}

/// Sets `out`, patch after patch, to the products of a matrix with patches, plus `offset` of each output.
pub(crate) fn project(weights: &PackedMatrix, patches: &[Sparse], offset: &[f32], out: &mut [Row]) {
    Arch::new().dispatch(Project {
        weights,
        patches,
        offset,
        out,
    });
}

/// Does so with numbers of any kind, in no hurry.
pub(crate) fn project_plainly<T: Copy + Mul<Output = T> + AddAssign>(
    weights: &PackedMatrix<T>,
    patches: &[Sparse<T>],
    offset: &[T],
    out: &mut [Row<T>],
) {
    for (x, out) in patches.iter().zip(out.chunks_exact_mut(weights.outputs)) {
        let groups = weights.groups.chunks_exact(weights.inputs);
        let outputs = out.chunks_mut(GROUP).zip(offset.chunks(GROUP));
        for ((out, offset), group) in outputs.zip(groups) {
            for (k, (out, &offset)) in out.iter_mut().zip(offset).enumerate() {
                *out = [offset; LANES];
                for (row, &input) in x.rows.iter().zip(&x.at) {
                    for (sum, &x) in out.iter_mut().zip(row) {
                        *sum += group[input as usize][k] * x;
                    }
                }
            }
        }
    }
}

struct Project<'a> {
    weights: &'a PackedMatrix,
    patches: &'a [Sparse],
    offset: &'a [f32],
    out: &'a mut [Row],
}

impl WithSimd for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // As many groups together as the registers hold.
        match S::F32_LANES {
            16 => self.run::<S, 1, 4>(simd),
            8 => self.run::<S, 2, 1>(simd),
            4 => self.run::<S, 4, 1>(simd),
            _ => self.run::<S, LANES, 1>(simd),
        }
    }
}

impl Project<'_> {
    /// Goes through all groups, `G` together, for each output `V` registers.
    #[inline(always)]
    fn run<S: Simd, const V: usize, const G: usize>(&mut self, simd: S) {
        let n = self.weights.inputs;
        let n_groups = self.weights.outputs.div_ceil(GROUP);
        let mut group = 0;
        // The entries of some groups stay in the nearest cache while all patches go by.
        while let Some(groups) = self.weights.groups.get(group * n..(group + G) * n) {
            self.groups::<S, V, G>(simd, groups, group);
            group += G;
        }
        while group < n_groups {
            let groups = &self.weights.groups[group * n..(group + 1) * n];
            self.groups::<S, V, 1>(simd, groups, group);
            group += 1;
        }
    }

    /// Goes through all patches with `G` groups of outputs.
    #[inline(always)]
    fn groups<S: Simd, const V: usize, const G: usize>(
        &mut self,
        simd: S,
        groups: &[[f32; GROUP]],
        first: usize,
    ) {
        let outs = self.out.chunks_exact_mut(self.weights.outputs);
        for (x, out) in self.patches.iter().zip(outs) {
            let sums = tile::<S, V, G>(simd, groups, x);
            let outs = out.iter_mut().zip(self.offset).skip(first * GROUP);
            for ((out, &offset), sums) in outs.zip(sums.as_flattened()) {
                let (out, _) = S::as_mut_simd_f32s(out);
                for (out, &sum) in out.iter_mut().zip(sums) {
                    *out = simd.add_f32s(sum, simd.splat_f32s(offset));
                }
            }
        }
    }
}

/// The products of `G` groups of outputs with a patch.
#[inline(always)]
fn tile<S: Simd, const V: usize, const G: usize>(
    simd: S,
    groups: &[[f32; GROUP]],
    x: &Sparse,
) -> [[[S::f32s; V]; GROUP]; G] {
    let n = groups.len() / G;
    let mut sums = [[[simd.splat_f32s(0.0); V]; GROUP]; G];
    for (row, &k) in x.rows.iter().zip(&x.at) {
        let (row, _) = S::as_simd_f32s(row);
        for (sums, weights) in sums.iter_mut().zip(groups.chunks_exact(n)) {
            for (sums, &weight) in sums.iter_mut().zip(&weights[k as usize]) {
                let weight = simd.splat_f32s(weight);
                for (sum, &x) in sums.iter_mut().zip(row) {
                    *sum = simd.mul_add_f32s(weight, x, *sum);
                }
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const INPUTS: usize = 37;

    /// Patches in which every other channel is zero at all or at some rows, one of them `-0`.
    fn patches(n: usize, random: &mut Random) -> Vec<Vec<Row>> {
        let mut row = |channel: usize, patch: usize| -> Row {
            std::array::from_fn(|lane| match (channel + patch) % 4 {
                0 => 0.0,
                1 if lane % 3 == 0 => -0.0,
                _ => random.normal() as f32,
            })
        };
        (0..n)
            .map(|patch| (0..INPUTS).map(|channel| row(channel, patch)).collect())
            .collect()
    }

    fn whole(rows: &[Row]) -> Sparse {
        let mut sparse = Sparse::default();
        for (channel, row) in (0_u32..).zip(rows) {
            sparse.push(channel, *row);
        }
        sparse
    }

    fn taken(rows: &[Row]) -> Sparse {
        let mut sparse = Sparse::default();
        sparse.take(rows);
        sparse
    }

    /// Random weights, row after row, and the same for products.
    fn weights(outputs: usize, random: &mut Random) -> (Vec<f32>, PackedMatrix) {
        let weights: Vec<f32> = (0..outputs * INPUTS)
            .map(|_| random.normal() as f32)
            .collect();
        let packed = PackedMatrix::new(outputs, INPUTS, |output, input| {
            weights[output * INPUTS + input]
        });
        (weights, packed)
    }

    #[test]
    fn products_are_the_plain_ones_and_zeros_change_no_bit() {
        for outputs in [1, 5, 6, 23, 24, 25, 50] {
            let mut random = Random::new(3, 0);
            let (weights, packed) = weights(outputs, &mut random);
            let offset: Vec<f32> = (0..outputs).map(|_| random.normal() as f32).collect();
            let patches = patches(5, &mut random);
            let all = |take: fn(&[Row]) -> Sparse| -> Vec<Row> {
                let xs: Vec<Sparse> = patches.iter().map(|rows| take(rows)).collect();
                let mut out = vec![[f32::NAN; LANES]; xs.len() * outputs];
                project(&packed, &xs, &offset, &mut out);
                out
            };
            let found = all(taken);
            assert!(taken(&patches[0]).rows.len() < INPUTS);
            assert_eq!(found, all(whole), "{outputs}");
            for (rows, found) in patches.iter().zip(found.chunks_exact(outputs)) {
                let mut alone = vec![[0.0; LANES]; outputs];
                project(&packed, &[taken(rows)], &offset, &mut alone);
                assert_eq!(alone, found, "{outputs}");
                for (output, found) in found.iter().enumerate() {
                    for (lane, &found) in found.iter().enumerate() {
                        let terms = rows.iter().enumerate().map(|(input, row)| {
                            f64::from(weights[output * INPUTS + input]) * f64::from(row[lane])
                        });
                        let expected = f64::from(offset[output]) + terms.sum::<f64>();
                        let off = (f64::from(found) - expected).abs();
                        assert!(off < 1e-5, "{outputs}: {found} instead of {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn registers_of_any_width_give_the_same_bits() {
        let mut random = Random::new(6, 0);
        let (_, weights) = weights(50, &mut random);
        let patches = patches(3, &mut random);
        let patches: Vec<Sparse> = patches.iter().map(|rows| taken(rows)).collect();
        let projected_by = |op: &dyn Fn(Project)| {
            let mut out = vec![[0.0; LANES]; 3 * 50];
            op(Project {
                weights: &weights,
                patches: &patches,
                offset: &[0.25; 50],
                out: &mut out,
            });
            out
        };
        let plain = projected_by(&|of| of.with_simd(pulp::Scalar::new()));
        assert!(plain.iter().flatten().all(|sum| *sum != 0.0));
        assert_eq!(plain, projected_by(&|of| Arch::new().dispatch(of)));
        #[cfg(target_arch = "x86_64")]
        if let Some(narrow) = pulp::x86::V3::try_new() {
            assert_eq!(plain, projected_by(&|of| Simd::vectorize(narrow, of)));
        }
    }

    #[test]
    fn the_plain_way_gives_the_same() {
        let mut random = Random::new(4, 0);
        let (_, packed) = weights(25, &mut random);
        let xs = patches(3, &mut random);
        let xs: Vec<Sparse> = xs.iter().map(|rows| taken(rows)).collect();
        let offset = [0.25; 25];
        let [mut fast, mut plain] = [(); 2].map(|()| vec![[0.0_f32; LANES]; 75]);
        project(&packed, &xs, &offset, &mut fast);
        project_plainly(&packed, &xs, &offset, &mut plain);
        for (fast, plain) in fast.iter().flatten().zip(plain.iter().flatten()) {
            assert!((fast - plain).abs() < 1e-5, "{fast}, {plain}");
        }
    }
}
