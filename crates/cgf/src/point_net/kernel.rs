//! Products for sixteen points side by side, in the widest registers that the processor has.
//!
//! Every sum is made by the same operations in the same order wherever it stands, so that results do
//! not depend on how the work is divided.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

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
        Self { inputs, groups }
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

/// Whether all numbers are zero: all bits but the sign's, so that they are looked at together.
#[inline(always)]
pub(super) fn are_zero(numbers: &[f32]) -> bool {
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
        for (k, row) in (0_u32..).zip(self.rows) {
            if !are_zero(row) {
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

impl WithSimd for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // As many groups together as the registers hold.
        match S::F32_LANES {
            16 => self.run::<S, 1, 2>(simd),
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
        let mut group = 0;
        while let Some(sums) = tile::<S, V, G>(simd, (self.weights, self.x), group) {
            for sums in &sums {
                self.store(simd, group * GROUP, sums);
                group += 1;
            }
        }
        while let Some([sums]) = tile::<S, V, 1>(simd, (self.weights, self.x), group) {
            self.store(simd, group * GROUP, &sums);
            group += 1;
        }
    }

    /// Stores the products of a group of outputs, whose first has this number.
    #[inline(always)]
    fn store<S: Simd, const V: usize>(
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

/// Turns a panel, patch after patch, channel after channel, into channel after channel, patch after
/// patch: what [`correlate`] reads lies together.
pub(super) fn by_channels(panel: &[Row], width: usize, out: &mut Vec<Row>) {
    let patches = panel.len() / width;
    out.resize(panel.len(), [0.0; LANES]);
    for (patch, rows) in panel.chunks_exact(width).enumerate() {
        for (row, out) in rows.iter().zip(out.iter_mut().skip(patch).step_by(patches)) {
            *out = *row;
        }
    }
}

/// Sets `out` `(width of a, width of b)` to the sums over all points of the products of channels, each
/// of which has so many `patches`, one after the other.
pub(super) fn correlate(a: &[Row], b: &[Row], patches: usize, pairs: Pairs, out: &mut [f32]) {
    Arch::new().dispatch(Correlate {
        a,
        b,
        patches,
        pairs,
        out,
    });
}

struct Correlate<'a> {
    a: &'a [Row],
    b: &'a [Row],
    patches: usize,
    pairs: Pairs,
    out: &'a mut [f32],
}

impl WithSimd for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // As many channels of either side as there are registers for their sums.
        match S::F32_LANES {
            16 => self.tiles::<S, 8, 3>(simd),
            _ => self.tiles::<S, 4, 3>(simd),
        }
    }
}

impl Correlate<'_> {
    #[inline(always)]
    fn tiles<S: Simd, const LEFT: usize, const RIGHT: usize>(&mut self, simd: S) {
        let (n_a, n_b) = (self.a.len() / self.patches, self.b.len() / self.patches);
        if n_a < LEFT || n_b < RIGHT {
            return self.plain();
        }
        for left in (0..n_a).step_by(LEFT) {
            // The last tile overlaps the one before it and finds the same again.
            let left = left.min(n_a - LEFT);
            for right in (0..n_b).step_by(RIGHT) {
                let right = right.min(n_b - RIGHT);
                if self.pairs == Pairs::Upper && right + RIGHT <= left {
                    continue;
                }
                let a: [&[S::f32s]; LEFT] =
                    std::array::from_fn(|i| channel::<S>(self.a, left + i, self.patches));
                let b: [&[S::f32s]; RIGHT] =
                    std::array::from_fn(|j| channel::<S>(self.b, right + j, self.patches));
                let mut sums = [[simd.splat_f32s(0.0); RIGHT]; LEFT];
                for v in 0..a[0].len() {
                    let b: [S::f32s; RIGHT] = std::array::from_fn(|j| b[j][v]);
                    for (sums, a) in sums.iter_mut().zip(&a) {
                        for (sum, &b) in sums.iter_mut().zip(&b) {
                            *sum = simd.mul_add_e_f32s(a[v], b, *sum);
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

    fn plain(&mut self) {
        let n_b = self.b.len() / self.patches;
        for (i, a) in self.a.chunks_exact(self.patches).enumerate() {
            for (j, b) in self.b.chunks_exact(self.patches).enumerate() {
                let pairs = a.as_flattened().iter().zip(b.as_flattened());
                self.out[i * n_b + j] = pairs.map(|(a, b)| a * b).sum();
            }
        }
    }
}

/// All numbers of a channel.
#[inline(always)]
fn channel<S: Simd>(channels: &[Row], channel: usize, patches: usize) -> &[S::f32s] {
    let rows = &channels[channel * patches..(channel + 1) * patches];
    S::as_simd_f32s(rows.as_flattened()).0
}
