//! Bias, activation and derivatives between two layers, in one pass over the rows.
//!
//! A patch of rows comes as one block of values or as three: values x, first derivatives x′ in time and
//! second ones x″. The activation f takes them to f(x), f′(x) x′ and f″(x) x′² + f′(x) x″.
//! Channels that are zero in all rows of a patch are left out.
//! Every loop is compiled for several instruction sets, and which is used is decided as it runs.

use pulp::{Arch, Simd, WithSimd};

use super::number::Number;
use crate::{
    config::Activation,
    product::{LANES, Row, Sparse},
};

/// A function between layers and its first two derivatives.
trait Function: Copy {
    fn value<T: Number>(self, x: T) -> T;
    fn derivatives<T: Number>(self, x: T) -> [T; 3];
}

#[derive(Clone, Copy)]
struct Relu;

#[derive(Clone, Copy)]
struct Silu;

impl Function for Relu {
    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn value<T: Number>(self, x: T) -> T {
        // NaN stays NaN.
        if x < T::zero() { T::zero() } else { x }
    }

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn derivatives<T: Number>(self, x: T) -> [T; 3] {
        let slope = if x > T::zero() { T::one() } else { T::zero() };
        [self.value(x), slope, T::zero()]
    }
}

impl Function for Silu {
    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn value<T: Number>(self, x: T) -> T {
        x / (T::one() + (T::zero() - x).exp())
    }

    /// With s = 1 / (1 + e⁻ˣ): x s, s (1 + x (1 − s)), s (1 − s) (2 + x (1 − 2 s)).
    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn derivatives<T: Number>(self, x: T) -> [T; 3] {
        let one = T::one();
        let s = one / (one + (T::zero() - x).exp());
        let rest = one - s;
        let slope = s * (one + x * rest);
        let bend = s * rest * (one + one + x * (rest - s));
        [x * s, slope, bend]
    }
}

/// Whether derivatives go along with the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DerivativeLevel {
    /// Values alone.
    Values,
    /// Values, then first, then second derivatives.
    Derivatives,
}

impl DerivativeLevel {
    /// Returns the number of blocks of rows.
    pub(super) fn blocks(self) -> usize {
        match self {
            Self::Values => 1,
            Self::Derivatives => 3,
        }
    }
}

/// Takes the products of a layer, `(patches, width)` of its bias, once (values) or three times (values,
/// first and second derivatives) for each patch, to the inputs of the next layer.
pub(super) fn activate<T: Number>(
    activation: Activation,
    products: &[Row<T>],
    bias: &[T],
    level: DerivativeLevel,
    outputs: &mut [Sparse<T>],
) {
    match activation {
        Activation::Relu => between(Relu, products, bias, level, outputs),
        Activation::Silu => between(Silu, products, bias, level, outputs),
    }
}

fn between<T: Number, F: Function>(
    function: F,
    products: &[Row<T>],
    bias: &[T],
    level: DerivativeLevel,
    outputs: &mut [Sparse<T>],
) {
    Arch::new().dispatch(Between {
        function,
        products,
        bias,
        level,
        outputs,
    });
}

struct Between<'a, T, F> {
    function: F,
    products: &'a [Row<T>],
    bias: &'a [T],
    level: DerivativeLevel,
    outputs: &'a mut [Sparse<T>],
}

impl<T: Number, F: Function> WithSimd for Between<'_, T, F> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            function,
            products,
            bias,
            level,
            outputs,
        } = self;
        let blocks = level.blocks();
        let patches = products.chunks_exact(blocks * bias.len());
        for (products, outputs) in patches.zip(outputs.chunks_exact_mut(blocks)) {
            for output in &mut *outputs {
                output.clear();
            }
            let (values, rates) = products.split_at(bias.len());
            let (firsts, seconds) = rates.split_at(rates.len() / 2);
            let channels = (0_u32..).zip(values.iter().zip(bias));
            match (level, outputs) {
                (DerivativeLevel::Values, [output]) => {
                    for (channel, (row, &bias)) in channels {
                        let mut x = *row;
                        for x in &mut x {
                            *x = function.value(*x + bias);
                        }
                        put(output, channel, x);
                    }
                }
                (DerivativeLevel::Derivatives, [values, to_firsts, to_seconds]) => {
                    let rates = firsts.iter().zip(seconds);
                    for ((channel, (row, &bias)), (first, second)) in channels.zip(rates) {
                        let [mut x, mut x_1, mut x_2] = [*row, *first, *second];
                        for ((x, x_1), x_2) in x.iter_mut().zip(&mut x_1).zip(&mut x_2) {
                            let [value, slope, bend] = function.derivatives(*x + bias);
                            *x_2 = bend * *x_1 * *x_1 + slope * *x_2;
                            *x_1 = slope * *x_1;
                            *x = value;
                        }
                        put(values, channel, x);
                        put(to_firsts, channel, x_1);
                        put(to_seconds, channel, x_2);
                    }
                }
                (DerivativeLevel::Values | DerivativeLevel::Derivatives, _) => {}
            }
        }
    }
}

/// Adds a channel that is not zero.
#[expect(
    clippy::inline_always,
    reason = "part of a loop for an instruction set"
)]
#[inline(always)]
fn put<T: Number>(output: &mut Sparse<T>, channel: u32, row: Row<T>) {
    if !T::are_zero(&row) {
        output.push(channel, row);
    }
}

/// First layer before its activation, for motions at given times; it is linear in time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start<'a, T> {
    /// Number of motions.
    pub(super) n_motions: usize,
    /// Its products with code and object, and its bias, for sixteen motions side by side.
    pub(super) motions: &'a [Row<T>],
    /// Its rate in time, `(width)`.
    pub(super) per_time: &'a [T],
    /// The times of every motion.
    pub(super) times: &'a [T],
}

impl<T: Number> Start<'_, T> {
    /// Returns the number of rows: a motion's times, then the next one's.
    pub(super) fn rows(&self) -> usize {
        self.n_motions * self.times.len()
    }

    /// Takes the rows from `first` on to the layer's outputs, patch by patch, once or three times.
    pub(super) fn layer(
        &self,
        activation: Activation,
        first: usize,
        level: DerivativeLevel,
        outputs: &mut [Sparse<T>],
    ) {
        match activation {
            Activation::Relu => self.through(Relu, first, level, outputs),
            Activation::Silu => self.through(Silu, first, level, outputs),
        }
    }

    fn through<F: Function>(
        &self,
        function: F,
        first: usize,
        level: DerivativeLevel,
        outputs: &mut [Sparse<T>],
    ) {
        for (patch, outputs) in outputs.chunks_exact_mut(level.blocks()).enumerate() {
            let (times, parts) = self.lanes(first + patch * LANES);
            Arch::new().dispatch(FirstLayer {
                function,
                per_time: self.per_time,
                times,
                parts: &parts,
                level,
                outputs,
            });
        }
    }

    /// Returns the times of a patch's rows, and the motions that have a part in it. Rows beyond the last
    /// are like the last.
    fn lanes(&self, first: usize) -> (Row<T>, Vec<Part<'_, T>>) {
        let (width, n_times) = (self.per_time.len(), self.times.len());
        let last = self.rows().saturating_sub(1);
        let mut times = [T::zero(); LANES];
        let mut parts: Vec<Part<'_, T>> = Vec::new();
        let mut newest = None;
        for (from, time) in times.iter_mut().enumerate() {
            let row = (first + from).min(last);
            *time = self.times[row % n_times];
            let motion = row / n_times;
            if newest != Some(motion) {
                newest = Some(motion);
                let patch = motion / LANES * width;
                parts.push(Part {
                    from,
                    known: &self.motions[patch..patch + width],
                    lane: motion % LANES,
                });
            }
        }
        (times, parts)
    }
}

/// A motion's part of a patch.
struct Part<'a, T> {
    /// Its first row.
    from: usize,
    /// Part of the first layer that is constant in time, for it and the motions beside it.
    known: &'a [Row<T>],
    /// Its lane among them.
    lane: usize,
}

struct FirstLayer<'a, T, F> {
    function: F,
    per_time: &'a [T],
    times: Row<T>,
    parts: &'a [Part<'a, T>],
    level: DerivativeLevel,
    outputs: &'a mut [Sparse<T>],
}

impl<T: Number, F: Function> WithSimd for FirstLayer<'_, T, F> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for output in &mut *self.outputs {
            output.clear();
        }
        for (channel, (k, &rate)) in (0_u32..).zip(self.per_time.iter().enumerate()) {
            let mut x = [T::zero(); LANES];
            for part in self.parts {
                let known = part.known[k][part.lane];
                for (lane, x) in x.iter_mut().enumerate() {
                    *x = if lane < part.from { *x } else { known };
                }
            }
            for (x, &time) in x.iter_mut().zip(&self.times) {
                *x += time * rate;
            }
            match (self.level, &mut *self.outputs) {
                (DerivativeLevel::Values, [output]) => {
                    for x in &mut x {
                        *x = self.function.value(*x);
                    }
                    put(output, channel, x);
                }
                (DerivativeLevel::Derivatives, [values, firsts, seconds]) => {
                    let (mut x_1, mut x_2) = ([T::zero(); LANES], [T::zero(); LANES]);
                    for ((x, x_1), x_2) in x.iter_mut().zip(&mut x_1).zip(&mut x_2) {
                        let [value, slope, bend] = self.function.derivatives(*x);
                        *x_2 = bend * rate * rate;
                        *x_1 = slope * rate;
                        *x = value;
                    }
                    put(values, channel, x);
                    put(firsts, channel, x_1);
                    put(seconds, channel, x_2);
                }
                (DerivativeLevel::Values | DerivativeLevel::Derivatives, _) => {}
            }
        }
    }
}

/// Adds the product of a row of inputs with a matrix, `(inputs, sums)`, to `sums`.
pub(super) fn add_product<T: Number>(sums: &mut [T], inputs: &[T], matrix: &[T]) {
    Arch::new().dispatch(AddProduct {
        sums,
        inputs,
        matrix,
    });
}

struct AddProduct<'a, T> {
    sums: &'a mut [T],
    inputs: &'a [T],
    matrix: &'a [T],
}

impl<T: Number> WithSimd for AddProduct<'_, T> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let rows = self.matrix.chunks_exact(self.sums.len());
        for (&input, weights) in self.inputs.iter().zip(rows) {
            for (sum, &weight) in self.sums.iter_mut().zip(weights) {
                *sum += input * weight;
            }
        }
    }
}
