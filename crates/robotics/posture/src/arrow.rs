//! Solves the normal equations, finger by finger and then the trunk.

#![expect(
    clippy::needless_range_loop,
    reason = "indices below a constant size read like the formulas, and unroll"
)]

use crate::layout::Layout;

/// The normal equations with some unknowns held.
#[derive(Debug, Clone, Copy)]
pub(crate) struct System<'a> {
    pub(crate) layout: &'a Layout,
    /// Second derivatives, as [`Layout`] says.
    pub(crate) hessian: &'a [f64],
    /// Minus the slopes, less the contributions of the held unknowns' steps.
    pub(crate) right: &'a [f64],
    /// Added to the diagonal.
    pub(crate) damping: &'a [f64],
    /// 1 for free unknowns, 0 for held ones.
    pub(crate) free: &'a [f64],
    /// Exclusive lower bound on every pivot.
    pub(crate) least_pivot: f64,
}

/// Memory to solve systems of one layout.
pub(crate) trait LinearSolver: std::fmt::Debug + Send {
    /// Writes the steps of the free unknowns and 0 for the held ones; returns false, with `step`
    /// in any state, if the matrix is not positive definite.
    fn solve(&mut self, system: &System<'_>, step: &mut [f64]) -> bool;

    /// Writes the steps for another right side with the matrix solved last, 0 for the unknowns
    /// held then.
    fn solve_again(&mut self, layout: &Layout, right: &[f64], free: &[f64], step: &mut [f64]);
}

/// Returns memory for systems of this layout.
pub(crate) fn eliminator(layout: &Layout) -> Box<dyn LinearSolver> {
    let finger = layout.stride - layout.n_trunk;
    match (finger, layout.n_trunk) {
        (0..=4, 0..=6) => Box::new(Arrow::<4, 6>::new(layout)),
        (0..=5, 0..=6) => Box::new(Arrow::<5, 6>::new(layout)),
        (0..=5, 0..=8) => Box::new(Arrow::<5, 8>::new(layout)),
        (0..=8, 0..=12) => Box::new(Arrow::<8, 12>::new(layout)),
        // All unknowns are coupled.
        (0, 0..=16) => Box::new(Arrow::<1, 16>::new(layout)),
        (0, 0..=24) => Box::new(Arrow::<1, 24>::new(layout)),
        (0..=16, 0..=24) => Box::new(Arrow::<16, 24>::new(layout)),
        _ => Box::new(Arrow::<64, 64>::new(layout)),
    }
}

/// The matrix of a finger's unknowns, with rows filled up to `F` and `T` numbers.
#[derive(Debug, Clone)]
struct Arrow<const F: usize, const T: usize> {
    fingers: Vec<[FingerRow<F, T>; F]>,
    trunk: Box<[TrunkRow<T>; T]>,
}

#[derive(Debug, Clone, Copy)]
struct FingerRow<const F: usize, const T: usize> {
    finger: [f64; F],
    trunk: [f64; T],
    right: f64,
}

#[derive(Debug, Clone, Copy)]
struct TrunkRow<const T: usize> {
    trunk: [f64; T],
    right: f64,
}

impl<const F: usize, const T: usize> Arrow<F, T> {
    fn new(layout: &Layout) -> Self {
        let finger = FingerRow {
            finger: [0.0; F],
            trunk: [0.0; T],
            right: 0.0,
        };
        let trunk = TrunkRow {
            trunk: [0.0; T],
            right: 0.0,
        };
        Self {
            fingers: vec![[finger; F]; layout.fingers.len()],
            trunk: Box::new([trunk; T]),
        }
    }
}

impl<const F: usize, const T: usize> LinearSolver for Arrow<F, T> {
    fn solve(&mut self, system: &System<'_>, step: &mut [f64]) -> bool {
        load_trunk(system, &mut self.trunk);
        for (rows, &(first, len)) in self.fingers.iter_mut().zip(&system.layout.fingers) {
            load_finger(system, first, len, rows);
            if !eliminate_finger(rows, &mut self.trunk, system.least_pivot) {
                return false;
            }
        }
        if !eliminate_trunk(&mut self.trunk, system.least_pivot) {
            return false;
        }
        self.substitute(system.layout, step);
        true
    }

    fn solve_again(&mut self, layout: &Layout, right: &[f64], free: &[f64], step: &mut [f64]) {
        for (u, row) in self.trunk.iter_mut().enumerate() {
            row.right = if u < layout.n_trunk {
                right[u] * free[u]
            } else {
                0.0
            };
        }
        for (rows, &(first, len)) in self.fingers.iter_mut().zip(&layout.fingers) {
            for (i, row) in rows.iter_mut().enumerate() {
                let u = first + i;
                row.right = if i < len { right[u] * free[u] } else { 0.0 };
            }
            for k in 0..F {
                let scaled = rows[k].right * rows[k].finger[k];
                for i in k + 1..F {
                    rows[i].right -= rows[k].finger[i] * scaled;
                }
                for (a, row) in self.trunk.iter_mut().enumerate() {
                    row.right -= rows[k].trunk[a] * scaled;
                }
            }
        }
        for a in 0..T {
            let scaled = self.trunk[a].right * self.trunk[a].trunk[a];
            for b in a + 1..T {
                self.trunk[b].right -= self.trunk[a].trunk[b] * scaled;
            }
        }
        self.substitute(layout, step);
    }
}

impl<const F: usize, const T: usize> Arrow<F, T> {
    /// Substitutes back, the trunk first.
    fn substitute(&self, layout: &Layout, step: &mut [f64]) {
        let trunk = substitute_trunk(&self.trunk);
        let n_trunk = layout.n_trunk;
        step[..n_trunk].copy_from_slice(&trunk[..n_trunk]);
        for (rows, &(first, len)) in self.fingers.iter().zip(&layout.fingers) {
            let finger = substitute_finger(rows, &trunk);
            step[first..first + len].copy_from_slice(&finger[..len]);
        }
    }
}

fn load_trunk<const T: usize>(system: &System<'_>, rows: &mut [TrunkRow<T>; T]) {
    let (n, stride) = (system.layout.n_trunk, system.layout.stride);
    let free = filled::<T>(&system.free[..n]);
    for (a, row) in rows.iter_mut().enumerate() {
        row.trunk = [0.0; T];
        if a >= n {
            row.trunk[a] = 1.0;
            row.right = 0.0;
            continue;
        }
        for b in a..n {
            row.trunk[b] = system.hessian[b * stride + a] * free[a] * free[b];
        }
        row.trunk[a] += system.damping[a] * free[a] + (1.0 - free[a]);
        row.right = system.right[a] * free[a];
    }
}

fn load_finger<const F: usize, const T: usize>(
    system: &System<'_>,
    first: usize,
    len: usize,
    rows: &mut [FingerRow<F, T>; F],
) {
    let (n_trunk, stride) = (system.layout.n_trunk, system.layout.stride);
    let free_trunk = filled::<T>(&system.free[..n_trunk]);
    let free_finger = filled::<F>(&system.free[first..first + len]);
    let damping = filled::<F>(&system.damping[first..first + len]);
    let right = filled::<F>(&system.right[first..first + len]);
    for (i, row) in rows.iter_mut().enumerate() {
        let free = free_finger[i];
        if i < len {
            let from = &system.hessian[(first + i) * stride..(first + i + 1) * stride];
            let (trunk, finger) = from.split_at(n_trunk);
            row.trunk = filled(trunk);
            row.finger = filled(&finger[..len]);
        } else {
            row.trunk = [0.0; T];
            row.finger = [0.0; F];
        }
        for a in 0..T {
            row.trunk[a] *= free * free_trunk[a];
        }
        for j in 0..F {
            row.finger[j] *= free * free_finger[j];
        }
        // A held unknown's row, and one that only fills up, says that its step is 0.
        row.finger[i] += damping[i] * free + (1.0 - free);
        row.right = right[i] * free;
    }
}

/// Returns the values, filled up with zeros to `N` of them.
#[inline]
fn filled<const N: usize>(values: &[f64]) -> [f64; N] {
    if let Ok(whole) = values.try_into() {
        return whole;
    }
    let mut filled = [0.0; N];
    filled[..values.len()].copy_from_slice(values);
    filled
}

/// Eliminates a finger's unknowns from its own rows and the trunk's (Schur complement). Each row's
/// diagonal is left as its inverse.
#[inline]
fn eliminate_finger<const F: usize, const T: usize>(
    rows: &mut [FingerRow<F, T>; F],
    trunk: &mut [TrunkRow<T>; T],
    least_pivot: f64,
) -> bool {
    let mut is_positive = true;
    for k in 0..F {
        let row = rows[k];
        let pivot = row.finger[k];
        is_positive &= pivot > least_pivot;
        let inverse = 1.0 / pivot;
        for i in k + 1..F {
            let factor = row.finger[i] * inverse;
            let lower = &mut rows[i];
            for j in i..F {
                lower.finger[j] -= factor * row.finger[j];
            }
            for j in 0..T {
                lower.trunk[j] -= factor * row.trunk[j];
            }
            lower.right -= factor * row.right;
        }
        for a in 0..T {
            let factor = row.trunk[a] * inverse;
            let lower = &mut trunk[a];
            for b in a..T {
                lower.trunk[b] -= factor * row.trunk[b];
            }
            lower.right -= factor * row.right;
        }
        rows[k].finger[k] = inverse;
    }
    is_positive
}

#[inline]
fn eliminate_trunk<const T: usize>(rows: &mut [TrunkRow<T>; T], least_pivot: f64) -> bool {
    let mut is_positive = true;
    for a in 0..T {
        let row = rows[a];
        let pivot = row.trunk[a];
        is_positive &= pivot > least_pivot;
        let inverse = 1.0 / pivot;
        for b in a + 1..T {
            let factor = row.trunk[b] * inverse;
            let lower = &mut rows[b];
            for c in b..T {
                lower.trunk[c] -= factor * row.trunk[c];
            }
            lower.right -= factor * row.right;
        }
        rows[a].trunk[a] = inverse;
    }
    is_positive
}

#[inline]
fn substitute_trunk<const T: usize>(rows: &[TrunkRow<T>; T]) -> [f64; T] {
    let mut step = [0.0; T];
    for a in (0..T).rev() {
        let row = &rows[a];
        let mut sum = row.right;
        for b in a + 1..T {
            sum -= row.trunk[b] * step[b];
        }
        step[a] = sum * row.trunk[a];
    }
    step
}

#[inline]
fn substitute_finger<const F: usize, const T: usize>(
    rows: &[FingerRow<F, T>; F],
    trunk: &[f64; T],
) -> [f64; F] {
    let mut step = [0.0; F];
    for k in (0..F).rev() {
        let row = &rows[k];
        let mut sum = row.right;
        for b in 0..T {
            sum -= row.trunk[b] * trunk[b];
        }
        for i in k + 1..F {
            sum -= row.finger[i] * step[i];
        }
        step[k] = sum * row.finger[k];
    }
    step
}
