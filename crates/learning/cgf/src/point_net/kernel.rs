//! Correlations of channels, for sixteen points side by side, in the widest registers that the processor
//! has.
//!
//! Every sum is made by the same operations in the same order wherever it stands, so that results do
//! not depend on how the work is divided.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::product::{LANES, Row};

/// Products of channels to compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pairs {
    All,
    /// Those at and above the diagonal; the others are unspecified.
    Upper,
}

/// Turns a panel, patch after patch, channel after channel, into channel after channel, patch after
/// patch, so that [`correlate`] reads contiguous memory.
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
                let mut sums = [[[0.0; LANES]; RIGHT]; LEFT];
                // One register of every patch at a time.
                for part in 0..LANES / S::F32_LANES {
                    let found = registers(simd, &a, &b, part);
                    for (sums, found) in sums.iter_mut().zip(&found) {
                        for (sums, &found) in sums.iter_mut().zip(found) {
                            S::as_mut_simd_f32s(sums).0[part] = found;
                        }
                    }
                }
                for (i, sums) in (left..).zip(&sums) {
                    for (j, sums) in (right..).zip(sums) {
                        self.out[i * n_b + j] = sum_of(sums);
                    }
                }
            }
        }
    }

    /// Sets the same sums without tiles, for few channels.
    #[inline(always)]
    fn plain(&mut self) {
        let n_b = self.b.len() / self.patches;
        for (i, a) in self.a.chunks_exact(self.patches).enumerate() {
            for (j, b) in self.b.chunks_exact(self.patches).enumerate() {
                let mut sums = [0.0; LANES];
                for (a, b) in a.iter().zip(b) {
                    for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                        *sum = a.mul_add(*b, *sum);
                    }
                }
                self.out[i * n_b + j] = sum_of(&sums);
            }
        }
    }
}

/// The sums over all patches of the products of channels, of one register of each patch.
#[inline(always)]
fn registers<S: Simd, const LEFT: usize, const RIGHT: usize>(
    simd: S,
    a: &[&[S::f32s]; LEFT],
    b: &[&[S::f32s]; RIGHT],
    part: usize,
) -> [[S::f32s; RIGHT]; LEFT] {
    let mut sums = [[simd.splat_f32s(0.0); RIGHT]; LEFT];
    for v in (part..a[0].len()).step_by(LANES / S::F32_LANES) {
        let b: [S::f32s; RIGHT] = std::array::from_fn(|j| b[j][v]);
        for (sums, a) in sums.iter_mut().zip(a) {
            for (sum, &b) in sums.iter_mut().zip(&b) {
                *sum = simd.mul_add_f32s(a[v], b, *sum);
            }
        }
    }
    sums
}

/// Sums a row in one order, whatever the width of registers: adds the upper half to the lower one until one number is
/// left.
#[inline(always)]
pub(super) fn sum_of(row: &Row) -> f32 {
    let mut sums = *row;
    let mut n = LANES;
    while n > 1 {
        n /= 2;
        for at in 0..n {
            sums[at] += sums[at + n];
        }
    }
    sums[0]
}

/// All numbers of a channel.
#[inline(always)]
fn channel<S: Simd>(channels: &[Row], channel: usize, patches: usize) -> &[S::f32s] {
    let rows = &channels[channel * patches..(channel + 1) * patches];
    S::as_simd_f32s(rows.as_flattened()).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const PATCHES: usize = 3;

    /// Correlations of so many channels, in registers of one width.
    fn correlated_by(channels: usize, op: impl Fn(Correlate)) -> Vec<f32> {
        let mut random = Random::new(8, 0);
        let mut row = || -> Row { std::array::from_fn(|_| random.normal() as f32) };
        let rows: Vec<Row> = (0..channels * PATCHES).map(|_| row()).collect();
        let mut out = vec![0.0; channels * channels];
        op(Correlate {
            a: &rows,
            b: &rows,
            patches: PATCHES,
            pairs: Pairs::All,
            out: &mut out,
        });
        out
    }

    #[test]
    fn registers_of_any_width_give_the_same_bits() {
        // Five channels are a tile of narrow registers, and none of wide ones.
        for channels in [3, 5, 9] {
            let plain = correlated_by(channels, |of| of.with_simd(pulp::Scalar::new()));
            assert!(plain.iter().all(|sum| *sum != 0.0));
            assert_eq!(
                plain,
                correlated_by(channels, |of| Arch::new().dispatch(of))
            );
            #[cfg(target_arch = "x86_64")]
            if let Some(narrow) = pulp::x86::V3::try_new() {
                assert_eq!(
                    plain,
                    correlated_by(channels, |of| Simd::vectorize(narrow, of))
                );
            }
        }
    }
}
