//! Products for sixteen points side by side, in the widest registers that the processor has.
//!
//! Every sum is made by the same operations in the same order wherever it stands, so that results do
//! not depend on how the work is divided.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::precision::row_index;

/// Points that are worked on together: a *patch*.
pub(super) const LANES: usize = 16;

/// One channel of a patch.
pub(super) type Row = [f32; LANES];

/// Outputs whose sums are kept in registers together: with sixteen points, twelve of the sixteen
/// registers of eight numbers that most processors have. Where a register holds sixteen numbers, two
/// groups are worked on together: sums of one alone would wait for each other.
const GROUP: usize = 6;

/// A matrix laid out for products with patches.
pub(super) struct Packed {
    inputs: usize,
    outputs: usize,
    /// For each group of outputs and each input, the group's entries; zero where there is no output.
    groups: Vec<[f32; GROUP]>,
}

impl Packed {
    /// Lays out a matrix of `outputs` rows, given by its entries at (output, input).
    pub(super) fn new(outputs: usize, inputs: usize, entry: impl Fn(usize, usize) -> f32) -> Self {
        let mut groups = Vec::with_capacity(outputs.div_ceil(GROUP) * inputs);
        for first in (0..outputs).step_by(GROUP) {
            groups.extend((0..inputs).map(|input| {
                std::array::from_fn(|k| {
                    let output = first + k;
                    if output < outputs {
                        entry(output, input)
                    } else {
                        0.0
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

    /// Outputs and what fills up their last group.
    pub(super) fn padded(&self) -> usize {
        self.outputs.next_multiple_of(GROUP)
    }
}

/// The channels of a patch that are not zero at all its points. Behind `max(x, 0)` neighbors are
/// mostly zero together, and what is left out adds nothing: results are the same to the bit.
#[derive(Default)]
pub(super) struct Sparse {
    rows: Vec<Row>,
    at: Vec<u32>,
}

impl Sparse {
    pub(super) fn take(&mut self, rows: &[Row]) {
        self.rows.clear();
        self.at.clear();
        Arch::new().dispatch(Take { sparse: self, rows });
    }
}

struct Take<'a> {
    sparse: &'a mut Sparse,
    rows: &'a [Row],
}

impl WithSimd for Take<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (k, row) in (0_u32..).zip(self.rows) {
            // All bits but the sign's, so that the numbers are looked at together.
            if row.iter().fold(0, |bits, x| bits | (x.to_bits() << 1)) != 0 {
                self.sparse.rows.push(*row);
                self.sparse.at.push(k);
            }
        }
    }
}

/// Sets `out` to the product of a matrix with a patch, plus `offset` of each output.
pub(super) fn project(weights: &Packed, x: &Sparse, offset: &[f32], out: &mut [Row]) {
    Arch::new().dispatch(Project {
        weights,
        x,
        offset,
        out,
    });
}

struct Project<'a> {
    weights: &'a Packed,
    x: &'a Sparse,
    offset: &'a [f32],
    out: &'a mut [Row],
}

impl Tiles for Project<'_> {
    fn factors(&self) -> (&Packed, &Sparse) {
        (self.weights, self.x)
    }

    #[inline(always)]
    fn take<S: Simd, const V: usize>(
        &mut self,
        simd: S,
        first: usize,
        sums: &[[S::f32s; V]; GROUP],
    ) {
        let outs = self.out.iter_mut().zip(self.offset).skip(first);
        for ((out, &offset), sums) in outs.zip(sums) {
            let (out, _) = S::as_mut_simd_f32s(out);
            for (out, &sum) in out.iter_mut().zip(sums) {
                *out = simd.add_f32s(sum, simd.splat_f32s(offset));
            }
        }
    }
}

impl WithSimd for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.all(simd);
    }
}

/// The largest product of each output so far, and the point that attained it.
pub(super) struct Largest {
    pub(super) value: Vec<f32>,
    pub(super) point: Vec<u32>,
}

impl Largest {
    pub(super) fn new(weights: &Packed) -> Self {
        Self {
            value: vec![f32::NEG_INFINITY; weights.padded()],
            point: vec![0; weights.padded()],
        }
    }

    /// Takes in the products with one patch, whose first point has the number `first`. Of equal ones
    /// the point that came first stays.
    pub(super) fn search(&mut self, weights: &Packed, x: &Sparse, first: u32) {
        Arch::new().dispatch(Search {
            weights,
            x,
            first,
            largest: self,
        });
    }
}

struct Search<'a> {
    weights: &'a Packed,
    x: &'a Sparse,
    first: u32,
    largest: &'a mut Largest,
}

impl Tiles for Search<'_> {
    fn factors(&self) -> (&Packed, &Sparse) {
        (self.weights, self.x)
    }

    #[inline(always)]
    fn take<S: Simd, const V: usize>(
        &mut self,
        simd: S,
        first: usize,
        sums: &[[S::f32s; V]; GROUP],
    ) {
        let Largest { value, point } = &mut *self.largest;
        let known = value.iter_mut().zip(point).skip(first);
        for (sums, (value, point)) in sums.iter().zip(known) {
            let mut top = sums[0];
            for &sum in &sums[1..] {
                top = simd.max_f32s(top, sum);
            }
            let over = simd.greater_than_f32s(top, simd.splat_f32s(*value));
            if simd.first_true_m32s(over) < S::F32_LANES {
                let largest = simd.reduce_max_f32s(top);
                let mut row = [0.0; LANES];
                let (vectors, _) = S::as_mut_simd_f32s(&mut row);
                vectors.copy_from_slice(sums);
                let lane = row.iter().position(|&x| x >= largest).unwrap_or(0);
                *value = largest;
                *point = self.first + row_index(lane);
            }
        }
    }
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.all(simd);
    }
}

/// Something that is done with the products of a matrix with a patch, group after group of outputs.
trait Tiles {
    /// The matrix and the patch.
    fn factors(&self) -> (&Packed, &Sparse);

    /// Takes the products of a group of outputs, whose first has this number: for each output `V`
    /// registers.
    fn take<S: Simd, const V: usize>(
        &mut self,
        simd: S,
        first: usize,
        sums: &[[S::f32s; V]; GROUP],
    );

    /// Goes through all groups, as many together as the registers hold.
    #[inline(always)]
    fn all<S: Simd>(&mut self, simd: S) {
        match S::F32_LANES {
            16 => self.run::<S, 1, 2>(simd),
            8 => self.run::<S, 2, 1>(simd),
            4 => self.run::<S, 4, 1>(simd),
            _ => self.run::<S, LANES, 1>(simd),
        }
    }

    /// Goes through all groups, `G` together.
    #[inline(always)]
    fn run<S: Simd, const V: usize, const G: usize>(&mut self, simd: S) {
        let mut group = 0;
        while let Some(sums) = tile::<S, V, G>(simd, self.factors(), group) {
            for sums in &sums {
                self.take(simd, group * GROUP, sums);
                group += 1;
            }
        }
        while let Some([sums]) = tile::<S, V, 1>(simd, self.factors(), group) {
            self.take(simd, group * GROUP, &sums);
            group += 1;
        }
    }
}

/// The products of `G` groups of outputs with a patch; `None` if there are not as many from `group` on.
#[inline(always)]
fn tile<S: Simd, const V: usize, const G: usize>(
    simd: S,
    (weights, x): (&Packed, &Sparse),
    group: usize,
) -> Option<[[[S::f32s; V]; GROUP]; G]> {
    let n = weights.inputs;
    let groups = weights.groups.get(group * n..(group + G) * n)?;
    let mut sums = [[[simd.splat_f32s(0.0); V]; GROUP]; G];
    for (row, &k) in x.rows.iter().zip(&x.at) {
        let (row, _) = S::as_simd_f32s(row);
        for (sums, weights) in sums.iter_mut().zip(groups.chunks_exact(n)) {
            for (sums, &weight) in sums.iter_mut().zip(&weights[k as usize]) {
                let weight = simd.splat_f32s(weight);
                for (sum, &x) in sums.iter_mut().zip(row) {
                    *sum = simd.mul_add_e_f32s(weight, x, *sum);
                }
            }
        }
    }
    Some(sums)
}

/// Which products of channels are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pairs {
    All,
    /// Those at and above the diagonal; what is below it is left as it comes.
    Upper,
}

/// Sets `out` `(width of a, width of b)` to the sums over all points of the products of two panels'
/// channels; a panel is patch after patch, channel after channel.
pub(super) fn correlate(a: (&[Row], usize), b: (&[Row], usize), pairs: Pairs, out: &mut [f32]) {
    Arch::new().dispatch(Correlate { a, b, pairs, out });
}

struct Correlate<'a> {
    a: (&'a [Row], usize),
    b: (&'a [Row], usize),
    pairs: Pairs,
    out: &'a mut [f32],
}

/// Channels of either side whose sums are kept in registers together.
const LEFT: usize = 4;
const RIGHT: usize = 3;

impl WithSimd for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ((a, n_a), (b, n_b)) = (self.a, self.b);
        if n_a < LEFT || n_b < RIGHT {
            return self.plain();
        }
        for left in (0..n_a).step_by(LEFT) {
            // The last block overlaps the one before it and finds the same again.
            let left = left.min(n_a - LEFT);
            for right in (0..n_b).step_by(RIGHT) {
                let right = right.min(n_b - RIGHT);
                if self.pairs == Pairs::Upper && right + RIGHT <= left {
                    continue;
                }
                let mut sums = [[simd.splat_f32s(0.0); RIGHT]; LEFT];
                for (a, b) in a.chunks_exact(n_a).zip(b.chunks_exact(n_b)) {
                    let a: [&[S::f32s]; LEFT] =
                        std::array::from_fn(|i| S::as_simd_f32s(&a[left + i]).0);
                    let b: [&[S::f32s]; RIGHT] =
                        std::array::from_fn(|j| S::as_simd_f32s(&b[right + j]).0);
                    for v in 0..LANES / S::F32_LANES {
                        for (sums, a) in sums.iter_mut().zip(&a) {
                            for (sum, b) in sums.iter_mut().zip(&b) {
                                *sum = simd.mul_add_e_f32s(a[v], b[v], *sum);
                            }
                        }
                    }
                }
                for (i, sums) in (left..).zip(&sums) {
                    for (j, &sum) in (right..).zip(sums) {
                        self.out[i * n_b + j] = simd.reduce_sum_f32s(sum);
                    }
                }
            }
        }
    }
}

impl Correlate<'_> {
    fn plain(self) {
        let ((a, n_a), (b, n_b)) = (self.a, self.b);
        self.out.fill(0.0);
        for (a, b) in a.chunks_exact(n_a).zip(b.chunks_exact(n_b)) {
            for (out, a) in self.out.chunks_exact_mut(n_b).zip(a) {
                for (out, b) in out.iter_mut().zip(b) {
                    *out += a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
                }
            }
        }
    }
}
