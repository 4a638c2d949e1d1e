//! Sums over points of the gradient by a layer's normalized output.

use pulp::{Arch, Simd, WithSimd};

use super::{
    super::{
        Layer, LayerStack, Normalized,
        cloud::{BLOCK, Cloud},
        kernel::sum_of,
        moments::clear_beyond,
    },
    add,
};
use crate::{
    precision::narrow,
    product::{LANES, Row},
};

/// Sums over points of the gradient `g` by a layer's normalized output.
pub(super) struct Sums {
    /// `Σ g`.
    pub(super) shift: Vec<f64>,
    /// `Σ g (y − mean)`; of the first layer `Σ g xyz` instead, three for each output.
    pub(super) gain: Vec<f64>,
}

/// Sums on their way: those of a block's patches are kept for each of the sixteen points alone.
pub(super) struct Running {
    sums: Sums,
    shift: Vec<Row>,
    gain: Vec<Row>,
    patches: usize,
}

/// Location of a gradient: a patch of a cloud, at the output of a layer.
pub(super) struct Place<'a> {
    cloud: &'a Cloud,
    patch: usize,
    idx: usize,
    layer: &'a Layer,
    normalized: &'a Normalized,
}

impl<'a> Place<'a> {
    pub(super) fn new(
        layer_stack: &'a LayerStack,
        idx: usize,
        cloud: &'a Cloud,
        patch: usize,
    ) -> Self {
        Self {
            cloud,
            patch,
            idx,
            layer: &layer_stack.layers[idx],
            normalized: &layer_stack.normalized[idx],
        }
    }
}

impl Sums {
    pub(super) fn new(layer: &Layer, idx: usize) -> Self {
        Self {
            shift: vec![0.0; layer.outputs],
            gain: vec![0.0; if idx == 0 { 3 } else { 1 } * layer.outputs],
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        add(&mut self.shift, &other.shift);
        add(&mut self.gain, &other.gain);
    }
}

impl Running {
    pub(super) fn new(layer: &Layer, idx: usize) -> Self {
        let sums = Sums::new(layer, idx);
        Self {
            shift: vec![[0.0; LANES]; sums.shift.len()],
            gain: vec![[0.0; LANES]; sums.gain.len()],
            sums,
            patches: 0,
        }
    }

    /// Adds a patch: sets `g` to zero where the output `x` was cut off and beyond the cloud's
    /// points, and sums it.
    pub(super) fn absorb(&mut self, at: &Place, x: &[Row], g: &mut [Row]) {
        Arch::new().dispatch(Absorb {
            running: self,
            at,
            x,
            g,
        });
        self.patches += 1;
        if self.patches == BLOCK {
            self.settle();
        }
    }

    /// Returns the sums.
    pub(super) fn finish(mut self) -> Sums {
        self.settle();
        self.sums
    }

    fn settle(&mut self) {
        self.patches = 0;
        Arch::new().dispatch(Settle(self));
    }
}

struct Absorb<'a> {
    running: &'a mut Running,
    at: &'a Place<'a>,
    x: &'a [Row],
    g: &'a mut [Row],
}

impl WithSimd for Absorb<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { running, at, x, g } = self;
        let zero = simd.splat_f32s(0.0);
        for (g, x) in g.iter_mut().zip(x) {
            let (g, x) = (S::as_mut_simd_f32s(g).0, S::as_simd_f32s(x).0);
            for (g, &x) in g.iter_mut().zip(x) {
                *g = simd.select_f32s(simd.greater_than_f32s(x, zero), *g, zero);
            }
        }
        clear_beyond(g, at.cloud.points_of(at.patch));
        for (sums, g) in running.shift.iter_mut().zip(g.iter()) {
            let (sums, g) = (S::as_mut_simd_f32s(sums).0, S::as_simd_f32s(g).0);
            for (sum, &g) in sums.iter_mut().zip(g) {
                *sum = simd.add_f32s(*sum, g);
            }
        }
        if at.idx == 0 {
            let xyz = at.cloud.coordinates(at.patch);
            for (sums, g) in running.gain.chunks_exact_mut(3).zip(g.iter()) {
                for (sums, x) in sums.iter_mut().zip(xyz) {
                    add_product(simd, sums, g, x, zero);
                }
            }
        } else {
            let y = at.cloud.linear(at.layer, at.idx, at.patch);
            let sums = running.gain.iter_mut().zip(&at.normalized.mean);
            for ((g, y), (sums, &mean)) in g.iter().zip(y).zip(sums) {
                add_product(simd, sums, g, y, simd.splat_f32s(narrow(mean)));
            }
        }
    }
}

/// `sums += g (y − mean)`.
#[inline(always)]
fn add_product<S: Simd>(simd: S, sums: &mut Row, g: &Row, y: &Row, mean: S::f32s) {
    let (sums, _) = S::as_mut_simd_f32s(sums);
    let (g, y) = (S::as_simd_f32s(g).0, S::as_simd_f32s(y).0);
    for ((sum, &g), &y) in sums.iter_mut().zip(g).zip(y) {
        *sum = simd.mul_add_f32s(g, simd.sub_f32s(y, mean), *sum);
    }
}

/// Puts the sums of the sixteen points together.
struct Settle<'a>(&'a mut Running);

impl WithSimd for Settle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Running {
            sums, shift, gain, ..
        } = self.0;
        for (sums, rows) in [(&mut sums.shift, shift), (&mut sums.gain, gain)] {
            for (sum, row) in sums.iter_mut().zip(rows) {
                *sum += f64::from(sum_of(row));
                *row = [0.0; LANES];
            }
        }
    }
}
