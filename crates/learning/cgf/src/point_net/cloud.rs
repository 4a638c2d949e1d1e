//! One cloud on its way up the layers.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined into the dispatch is not compiled for wide registers"
)]

use pulp::{Arch, Simd, WithSimd};

use super::{
    Affine, Layer, LayerStack,
    moments::{Moments, Scratch},
    order::near_together,
    search::Largest,
};
use crate::product::{LANES, Row, Sparse, project};

/// Patches whose moments are measured together.
pub(super) const BLOCK: usize = 32;

/// A cloud's points in patches of sixteen, and what the layers make of them.
///
/// A *panel* is patch after patch, channel after channel, sixteen points side by side; where points
/// are not a multiple of sixteen, the last patch repeats its first one.
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
    pub(super) fn input(
        &self,
        layer_stack: &LayerStack,
        level: usize,
        patch: usize,
        out: &mut [Row],
    ) {
        let Some(below) = level.checked_sub(1) else {
            out.copy_from_slice(self.coordinates(patch));
            return;
        };
        let (layer, affine) = (&layer_stack.layers[below], &layer_stack.affine[below]);
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
    pub(super) fn raise(&mut self, layer_stack: &LayerStack, level: usize) {
        let mut scratch = LayerScratch::default();
        for level in 2..=level {
            let below = layer_stack.layers[level - 1].outputs;
            self.linear.push(Vec::with_capacity(self.patches() * below));
            for patch in 0..self.patches() {
                self.raise_patch(layer_stack, level, patch, &mut scratch);
            }
        }
    }

    /// Computes the layer below `level` where it is not yet, and searches the last layer's maxima if
    /// `level` is the last; `see` gets the input of layer `level` block by block and the number of
    /// points of each.
    fn climb(
        &mut self,
        layer_stack: &LayerStack,
        level: usize,
        mut see: impl FnMut(&[Row], usize),
    ) {
        let top = level + 1 == layer_stack.layers.len();
        let width = layer_stack.layers[level].inputs;
        let mut largest = Largest::new(&layer_stack.signed);
        let (mut scratch, mut block) = (LayerScratch::default(), Vec::new());
        let raises = level >= 2 && self.linear.len() < level - 1;
        if raises {
            let below = layer_stack.layers[level - 1].outputs;
            self.linear.push(Vec::with_capacity(self.patches() * below));
        }
        for first in (0..self.patches()).step_by(BLOCK) {
            let patches = first..(first + BLOCK).min(self.patches());
            block.resize(patches.len() * width, [0.0; LANES]);
            for (patch, x) in patches.clone().zip(block.chunks_exact_mut(width)) {
                if raises {
                    self.raise_patch(layer_stack, level, patch, &mut scratch);
                }
                self.input(layer_stack, level, patch, x);
                if top {
                    largest.search(&layer_stack.signed, x, patch * LANES);
                }
            }
            see(&block, patches.map(|patch| self.points_of(patch)).sum());
        }
        if top {
            let gain = &layer_stack.layers[level].gain;
            let (value, point) = largest.found();
            self.attained = value
                .iter()
                .zip(gain)
                .map(|(&value, &gain)| if gain < 0.0 { -value } else { value })
                .collect();
            self.critical = point;
        }
    }

    /// Climbs to layer `level` and measures the moments of its input.
    pub(super) fn measure(&mut self, layer_stack: &LayerStack, level: usize) -> Moments {
        let width = layer_stack.layers[level].inputs;
        let mut scratch = Scratch::default();
        let mut all = Moments::default();
        self.climb(layer_stack, level, |panel, n| {
            all.add(&Moments::measure(panel, width, n, &mut scratch));
        });
        all
    }

    /// Computes all layers and searches the maxima.
    pub(super) fn search(&mut self, layer_stack: &LayerStack) {
        let last = layer_stack.layers.len() - 1;
        if last > 2 {
            self.raise(layer_stack, last - 1);
        }
        self.climb(layer_stack, last, |_, _| ());
        self.linear = Vec::new();
    }

    /// Adds a patch to the layer below `level`.
    fn raise_patch(
        &mut self,
        layer_stack: &LayerStack,
        level: usize,
        patch: usize,
        scratch: &mut LayerScratch,
    ) {
        let layer = &layer_stack.layers[level - 1];
        scratch.rows.resize(layer.inputs, [0.0; LANES]);
        self.input(layer_stack, level - 1, patch, &mut scratch.rows);
        scratch.sparse.take(&scratch.rows);
        scratch.zeros.resize(layer.outputs, 0.0);
        let linear = &mut self.linear[level - 2];
        let start = linear.len();
        linear.resize(start + layer.outputs, [0.0; LANES]);
        let out = &mut linear[start..];
        let x = std::slice::from_ref(&scratch.sparse);
        project(&layer_stack.packed[level - 2], x, &scratch.zeros, out);
    }
}

/// Room for intermediate results.
#[derive(Default)]
struct LayerScratch {
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
    fn with_simd<S: Simd>(self, simd: S) {
        let [x, y, z] = [0, 1, 2].map(|axis| S::as_simd_f32s(&self.xyz[axis]).0);
        let zero = simd.splat_f32s(0.0);
        let weights = self.layer.weight.chunks_exact(3);
        let affine = self.affine.scale.iter().zip(&self.affine.offset);
        for ((out, w), (&scale, &offset)) in self.out.iter_mut().zip(weights).zip(affine) {
            let [a, b, c] = [0, 1, 2].map(|axis| simd.splat_f32s(w[axis] * scale));
            let offset = simd.splat_f32s(offset);
            let (out, _) = S::as_mut_simd_f32s(out);
            for (((out, &x), &y), &z) in out.iter_mut().zip(x).zip(y).zip(z) {
                let sum = simd.mul_add_f32s(a, x, offset);
                let sum = simd.mul_add_f32s(c, z, simd.mul_add_f32s(b, y, sum));
                *out = simd.max_f32s(sum, zero);
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
    fn with_simd<S: Simd>(self, simd: S) {
        let zero = simd.splat_f32s(0.0);
        let affine = self.affine.scale.iter().zip(&self.affine.offset);
        for ((out, y), (&scale, &offset)) in self.out.iter_mut().zip(self.linear).zip(affine) {
            let [scale, offset] = [scale, offset].map(|x| simd.splat_f32s(x));
            let (out, y) = (S::as_mut_simd_f32s(out).0, S::as_simd_f32s(y).0);
            for (out, &y) in out.iter_mut().zip(y) {
                *out = simd.max_f32s(simd.mul_add_f32s(scale, y, offset), zero);
            }
        }
    }
}
