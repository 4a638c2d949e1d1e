//! The nearest points of a hand to the points of an object.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use crate::precision::row_index;

/// Points that are worked on side by side.
const LANES: usize = 16;

/// Points in meters, side by side.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cloud {
    /// x, y and z of so many points; the last point again where there is none.
    blocks: Vec<[[f32; LANES]; 3]>,
    len: usize,
}

/// The nearest of some points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearest {
    /// Its number.
    pub(crate) idx: u32,
    /// Squared distance, in m²; infinite if there are no points.
    pub(crate) squared_m2: f32,
}

impl Cloud {
    /// Takes `xyz`, point after point.
    pub(crate) fn new(xyz: &[f32]) -> Self {
        let block = |points: &[f32]| {
            let mut block = [[0.0; LANES]; 3];
            let last = points.len() / 3 - 1;
            for lane in 0..LANES {
                for (axis, row) in block.iter_mut().enumerate() {
                    row[lane] = points[3 * lane.min(last) + axis];
                }
            }
            block
        };
        Self {
            blocks: xyz.chunks(3 * LANES).map(block).collect(),
            len: xyz.len() / 3,
        }
    }

    /// Returns the number of points.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Returns the place of a point.
    pub(crate) fn point(&self, idx: usize) -> [f32; 3] {
        let (block, lane) = (&self.blocks[idx / LANES], idx % LANES);
        [block[0][lane], block[1][lane], block[2][lane]]
    }

    /// Returns for each point the nearest of others; of equals the first.
    pub(crate) fn nearest(&self, others: &[[f32; 3]]) -> Vec<Nearest> {
        let mut found = Vec::with_capacity(self.blocks.len() * LANES);
        Arch::new().dispatch(Search {
            blocks: &self.blocks,
            others,
            found: &mut found,
        });
        found.truncate(self.len);
        found
    }
}

struct Search<'a> {
    blocks: &'a [[[f32; LANES]; 3]],
    others: &'a [[f32; 3]],
    found: &'a mut Vec<Nearest>,
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for [xs, ys, zs] in self.blocks {
            let mut least = [f32::INFINITY; LANES];
            let mut which = [0_u32; LANES];
            for (number, &[x, y, z]) in self.others.iter().enumerate() {
                let number = row_index(number);
                for lane in 0..LANES {
                    let (dx, dy, dz) = (xs[lane] - x, ys[lane] - y, zs[lane] - z);
                    let squared = dx * dx + dy * dy + dz * dz;
                    let is_nearer = squared < least[lane];
                    least[lane] = if is_nearer { squared } else { least[lane] };
                    which[lane] = if is_nearer { number } else { which[lane] };
                }
            }
            let lanes = which.into_iter().zip(least);
            self.found
                .extend(lanes.map(|(idx, squared_m2)| Nearest { idx, squared_m2 }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{precision::narrow, random::Random};

    #[test]
    fn the_nearest_is_the_one_that_a_plain_search_finds() {
        let mut random = Random::new(3, 0);
        let mut draw =
            |n: usize| -> Vec<f32> { (0..3 * n).map(|_| narrow(random.normal())).collect() };
        let (points, others) = (draw(37), draw(50));
        let others: Vec<[f32; 3]> = others.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        let cloud = Cloud::new(&points);
        let found = cloud.nearest(&others);
        assert_eq!((cloud.len(), found.len()), (37, 37));
        for (idx, (point, found)) in points.chunks_exact(3).zip(found).enumerate() {
            assert_eq!(cloud.point(idx), point);
            let squared =
                |other: &[f32; 3]| -> f32 { (0..3).map(|k| (point[k] - other[k]).powi(2)).sum() };
            let best = (0..50).min_by(|&a, &b| squared(&others[a]).total_cmp(&squared(&others[b])));
            assert_eq!(found.idx as usize, best.unwrap());
            assert!((found.squared_m2 - squared(&others[best.unwrap()])).abs() < 1e-6);
        }
        assert!(cloud.nearest(&[])[0].squared_m2.is_infinite());
    }
}
