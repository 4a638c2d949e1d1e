//! The search for the largest product of each output among many points; the products are never stored.
//!
//! Here the outputs lie side by side in a register and points are gone through a few at a time, so
//! that a point's number is compared with what is known of many outputs at once.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::precision::row_index;
use crate::product::{Row, are_zero};

/// Outputs whose entries lie side by side.
const OUTPUTS: usize = 32;

/// Registers of outputs that are worked on together.
const REGISTERS: usize = 2;

/// Points that are worked on together, a part of a patch.
pub(super) const NEIGHBORS: usize = 8;

/// A matrix laid out for the search.
pub(super) struct Columns {
    inputs: usize,
    outputs: usize,
    /// For each group of outputs and each input, the group's entries; zero where there is no output.
    groups: Vec<[f32; OUTPUTS]>,
}

impl Columns {
    /// Lays out a matrix of `outputs` rows, given by its entries at (output, input).
    pub(super) fn new(outputs: usize, inputs: usize, entry: impl Fn(usize, usize) -> f32) -> Self {
        let mut groups = vec![[0.0; OUTPUTS]; outputs.div_ceil(OUTPUTS) * inputs];
        for output in 0..outputs {
            let group = &mut groups[output / OUTPUTS * inputs..][..inputs];
            for (input, entries) in group.iter_mut().enumerate() {
                entries[output % OUTPUTS] = entry(output, input);
            }
        }
        Self {
            inputs,
            outputs,
            groups,
        }
    }
}

/// The channels of a few points that are not zero at all of them.
#[derive(Default)]
struct Neighbors {
    rows: Vec<[f32; NEIGHBORS]>,
    at: Vec<u32>,
}

/// The largest product of each output so far, and the point that attained it.
pub(super) struct Largest {
    outputs: usize,
    value: Vec<[f32; OUTPUTS]>,
    point: Vec<[u32; OUTPUTS]>,
    /// Room for the points at hand.
    neighbors: Neighbors,
}

impl Largest {
    pub(super) fn new(weights: &Columns) -> Self {
        let groups = weights.outputs.div_ceil(OUTPUTS);
        Self {
            outputs: weights.outputs,
            value: vec![[f32::NEG_INFINITY; OUTPUTS]; groups],
            point: vec![[0; OUTPUTS]; groups],
            neighbors: Neighbors::default(),
        }
    }

    /// Takes in the products with one patch, whose first point has the number `first`. Of equal ones
    /// the point that came first stays.
    pub(super) fn search(&mut self, weights: &Columns, patch: &[Row], first: usize) {
        Arch::new().dispatch(Search {
            weights,
            patch,
            first,
            largest: self,
        });
    }

    /// Returns the largest products and the numbers of the points that attained them.
    pub(super) fn found(&self) -> (Vec<f32>, Vec<u32>) {
        let mut value = self.value.concat();
        let mut point = self.point.concat();
        value.truncate(self.outputs);
        point.truncate(self.outputs);
        (value, point)
    }
}

struct Search<'a> {
    weights: &'a Columns,
    patch: &'a [Row],
    first: usize,
    largest: &'a mut Largest,
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for part in 0..size_of::<Row>() / size_of::<[f32; NEIGHBORS]>() {
            self.largest.neighbors.take(self.patch, part);
            let first = self.first + part * NEIGHBORS;
            // As many sums as there are registers for, with those of the factors.
            match S::F32_LANES {
                16 => self.look::<S, 8>(simd, first),
                _ => self.look::<S, 4>(simd, first),
            }
        }
    }
}

impl Neighbors {
    /// Takes the points of one part of a patch.
    #[inline(always)]
    fn take(&mut self, patch: &[Row], part: usize) {
        self.rows.clear();
        self.at.clear();
        for (k, row) in (0_u32..).zip(patch) {
            let row: [f32; NEIGHBORS] = std::array::from_fn(|point| row[part * NEIGHBORS + point]);
            if !are_zero(&row) {
                self.rows.push(row);
                self.at.push(k);
            }
        }
    }
}

impl Search<'_> {
    /// Looks at the neighbors, `P` points at a time; the first of them has the number `first`.
    #[inline(always)]
    fn look<S: Simd, const P: usize>(&mut self, simd: S, first: usize) {
        let Largest {
            value,
            point,
            neighbors,
            ..
        } = &mut *self.largest;
        let groups = self.weights.groups.chunks_exact(self.weights.inputs);
        for ((weights, value), point) in groups.zip(value).zip(point) {
            let (values, _) = S::as_mut_simd_f32s(value);
            let (points, _) = S::as_mut_simd_u32s(point);
            let tiles = values
                .chunks_exact_mut(REGISTERS)
                .zip(points.chunks_exact_mut(REGISTERS));
            for (tile, (values, points)) in tiles.enumerate() {
                for from in (0..NEIGHBORS).step_by(P) {
                    let sums = products::<S, P>(simd, weights, tile, neighbors, from);
                    for (k, sums) in sums.iter().enumerate() {
                        let number = simd.splat_u32s(row_index(first + from + k));
                        let known = values.iter_mut().zip(points.iter_mut());
                        for ((value, point), &sum) in known.zip(sums) {
                            let over = simd.greater_than_f32s(sum, *value);
                            *value = simd.select_f32s(over, sum, *value);
                            *point = simd.select_u32s(over, number, *point);
                        }
                    }
                }
            }
        }
    }
}

/// The products of a tile of a group's outputs with the `P` neighbors that begin with `from`.
#[inline(always)]
fn products<S: Simd, const P: usize>(
    simd: S,
    weights: &[[f32; OUTPUTS]],
    tile: usize,
    neighbors: &Neighbors,
    from: usize,
) -> [[S::f32s; REGISTERS]; P] {
    let mut sums = [[simd.splat_f32s(0.0); REGISTERS]; P];
    for (row, &k) in neighbors.rows.iter().zip(&neighbors.at) {
        let (weights, _) = S::as_simd_f32s(&weights[k as usize]);
        let weights: [S::f32s; REGISTERS] =
            std::array::from_fn(|register| weights[tile * REGISTERS + register]);
        for (sums, &x) in sums.iter_mut().zip(&row[from..from + P]) {
            let x = simd.splat_f32s(x);
            for (sum, &weight) in sums.iter_mut().zip(&weights) {
                *sum = simd.mul_add_f32s(weight, x, *sum);
            }
        }
    }
    sums
}
