//! One cloud on its way up the layers.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use super::{
    Affine, Ladder, Layer,
    kernel::{LANES, Largest, Row, Sparse, project},
    moments::{Moments, Room},
    order::near_together,
};
use crate::precision::row_index;

/// Patches whose moments are measured together.
pub(super) const BLOCK: usize = 32;

/// A cloud's points in patches of sixteen, and what the layers make of them.
///
/// A *panel* is patch after patch, channel after channel, sixteen points side by side; where points
/// are no multiple of sixteen, the last patch repeats its first one.
pub(super) struct Cloud {
    pub(super) n: usize,
    /// Panel of the coordinates.
    xyz: Vec<Row>,
    /// Panels of the hidden layers but the first, before normalization.
    linear: Vec<Vec<Row>>,
    /// Number of the point that attains each output's maximum, and what the last layer gives there
    /// before normalization.
    pub(super) critical: Vec<u32>,
    pub(super) attained: Vec<f32>,
}

impl Cloud {
    /// Takes points `xyz`, neighbors together.
    pub(super) fn of_neighbors(xyz: &[f32]) -> Self {
        let points: Vec<[f32; 3]> = xyz
            .chunks_exact(3)
            .map(|point| std::array::from_fn(|k| point[k]))
            .collect();
        let order = near_together(&points, LANES);
        Self::new(order.iter().map(|&point| points[point as usize]))
    }

    /// Takes points in the order in which they come.
    pub(super) fn new(points: impl Iterator<Item = [f32; 3]>) -> Self {
        let mut xyz: Vec<Row> = Vec::new();
        let mut n = 0;
        for point in points {
            if n % LANES == 0 {
                xyz.extend(point.map(|x| [x; LANES]));
            }
            let at = xyz.len() - 3;
            for (row, x) in xyz[at..].iter_mut().zip(point) {
                row[n % LANES] = x;
            }
            n += 1;
        }
        Self {
            n,
            xyz,
            linear: Vec::new(),
            critical: Vec::new(),
            attained: Vec::new(),
        }
    }

    pub(super) fn patches(&self) -> usize {
        self.n.div_ceil(LANES)
    }

    /// Returns how many points of a patch are the cloud's.
    pub(super) fn points_of(&self, patch: usize) -> usize {
        (self.n - patch * LANES).min(LANES)
    }

    pub(super) fn point(&self, point: u32) -> [f32; 3] {
        let point = point as usize;
        std::array::from_fn(|k| self.xyz[point / LANES * 3 + k][point % LANES])
    }

    pub(super) fn coordinates(&self, patch: usize) -> &[Row] {
        &self.xyz[patch * 3..(patch + 1) * 3]
    }

    /// A hidden layer of a patch before normalization; the first is not kept.
    pub(super) fn linear(&self, layer: &Layer, idx: usize, patch: usize) -> &[Row] {
        let width = layer.outputs;
        &self.linear[idx - 1][patch * width..(patch + 1) * width]
    }

    /// Computes the input of layer `level` at a patch.
    pub(super) fn input(&self, ladder: &Ladder, level: usize, patch: usize, out: &mut [Row]) {
        let Some(below) = level.checked_sub(1) else {
            out.copy_from_slice(self.coordinates(patch));
            return;
        };
        let (layer, affine) = (&ladder.layers[below], &ladder.affine[below]);
        if below == 0 {
            let xyz = self.coordinates(patch);
            Arch::new().dispatch(FirstHidden {
                xyz,
                layer,
                affine,
                out,
            });
        } else {
            let linear = self.linear(layer, below, patch);
            Arch::new().dispatch(Hidden {
                linear,
                affine,
                out,
            });
        }
    }

    /// Computes the layers below `level`, each from the one below it.
    pub(super) fn raise(&mut self, ladder: &Ladder, level: usize) {
        let mut room = Below::default();
        for level in 2..=level {
            self.linear.push(Vec::new());
            for patch in 0..self.patches() {
                self.raise_patch(ladder, level, patch, &mut room);
            }
        }
    }

    /// Computes the layer below `level` where it is not yet, and searches the last layer's maxima if
    /// `level` is the last; `see` gets the input of layer `level` block by block and the number of
    /// points of each.
    fn climb(&mut self, ladder: &Ladder, level: usize, mut see: impl FnMut(&[Row], usize)) {
        let top = level + 1 == ladder.layers.len();
        let width = ladder.layers[level].inputs;
        let mut largest = Largest::new(&ladder.signed);
        let (mut room, mut block) = (Below::default(), Vec::new());
        let raises = level >= 2 && self.linear.len() < level - 1;
        if raises {
            self.linear.push(Vec::new());
        }
        for first in (0..self.patches()).step_by(BLOCK) {
            let patches = first..(first + BLOCK).min(self.patches());
            block.resize(patches.len() * width, [0.0; LANES]);
            for (patch, x) in patches.clone().zip(block.chunks_exact_mut(width)) {
                if raises {
                    self.raise_patch(ladder, level, patch, &mut room);
                }
                self.input(ladder, level, patch, x);
                if top {
                    room.sparse.take(x);
                    largest.search(&ladder.signed, &room.sparse, row_index(patch * LANES));
                }
            }
            see(&block, patches.map(|patch| self.points_of(patch)).sum());
        }
        if top {
            let gain = &ladder.layers[level].gain;
            self.attained = largest
                .value
                .iter()
                .zip(gain)
                .map(|(&value, &gain)| if gain < 0.0 { -value } else { value })
                .collect();
            self.critical = largest.point;
            self.critical.truncate(gain.len());
        }
    }

    /// Climbs to layer `level` and measures the moments of its input.
    pub(super) fn measure(&mut self, ladder: &Ladder, level: usize) -> Moments {
        let width = ladder.layers[level].inputs;
        let mut room = Room::default();
        let mut all = Moments::default();
        self.climb(ladder, level, |panel, n| {
            all.add(&Moments::measure(panel, width, n, &mut room));
        });
        all
    }

    /// Computes all layers and searches the maxima.
    pub(super) fn search(&mut self, ladder: &Ladder) {
        let last = ladder.layers.len() - 1;
        if last > 2 {
            self.raise(ladder, last - 1);
        }
        self.climb(ladder, last, |_, _| ());
        self.linear = Vec::new();
    }

    /// Adds a patch to the layer below `level`.
    fn raise_patch(&mut self, ladder: &Ladder, level: usize, patch: usize, room: &mut Below) {
        let layer = &ladder.layers[level - 1];
        room.rows.resize(layer.inputs, [0.0; LANES]);
        self.input(ladder, level - 1, patch, &mut room.rows);
        room.sparse.take(&room.rows);
        room.zeros.resize(layer.outputs, 0.0);
        let linear = &mut self.linear[level - 2];
        let start = linear.len();
        linear.resize(start + layer.outputs, [0.0; LANES]);
        let out = &mut linear[start..];
        project(&ladder.packed[level - 2], &room.sparse, &room.zeros, out);
    }
}

/// Room for intermediate results.
#[derive(Default)]
struct Below {
    rows: Vec<Row>,
    sparse: Sparse,
    zeros: Vec<f32>,
}

/// `max(scale (w · xyz) + offset, 0)` of a patch.
struct FirstHidden<'a> {
    xyz: &'a [Row],
    layer: &'a Layer,
    affine: &'a Affine,
    out: &'a mut [Row],
}

impl WithSimd for FirstHidden<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let [x, y, z] = [&self.xyz[0], &self.xyz[1], &self.xyz[2]];
        let weights = self.layer.weight.chunks_exact(3);
        let affine = self.affine.scale.iter().zip(&self.affine.offset);
        for ((out, w), (&scale, &offset)) in self.out.iter_mut().zip(weights).zip(affine) {
            let [a, b, c] = [w[0] * scale, w[1] * scale, w[2] * scale];
            for (k, out) in out.iter_mut().enumerate() {
                *out = (a * x[k] + b * y[k] + c * z[k] + offset).max(0.0);
            }
        }
    }
}

/// `max(scale y + offset, 0)` of a patch.
struct Hidden<'a> {
    linear: &'a [Row],
    affine: &'a Affine,
    out: &'a mut [Row],
}

impl WithSimd for Hidden<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let affine = self.affine.scale.iter().zip(&self.affine.offset);
        for ((out, y), (&scale, &offset)) in self.out.iter_mut().zip(self.linear).zip(affine) {
            for (out, &y) in out.iter_mut().zip(y) {
                *out = (scale * y + offset).max(0.0);
            }
        }
    }
}
