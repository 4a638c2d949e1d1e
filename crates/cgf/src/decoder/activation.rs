//! What lies between two layers, in one pass over the rows: bias, activation, derivatives.
//!
//! Rows come as one block of values or as three: values x, first derivatives x′ in time and second
//! ones x″. The activation f takes them to f(x), f′(x) x′ and f″(x) x′² + f′(x) x″.
//! Every loop is compiled for several instruction sets, and which is used is decided as it runs.

use pulp::{Arch, Simd, WithSimd};

use super::number::Number;
use crate::config::Activation;

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
        // What is no number stays none.
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

/// Takes the products of a layer to what the next layer is multiplied with: `rows` of the bias' width,
/// once (values) or three times (values, first and second derivatives).
pub(super) fn activate<T: Number>(
    activation: Activation,
    products: &[T],
    bias: &[T],
    order: Order,
) -> Vec<T> {
    match activation {
        Activation::Relu => between(Relu, products, bias, order),
        Activation::Silu => between(Silu, products, bias, order),
    }
}

/// Whether derivatives go along with the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// Values alone.
    Values,
    /// Values, then first, then second derivatives.
    Derivatives,
}

impl Order {
    /// Returns how many blocks of rows there are.
    pub(super) fn blocks(self) -> usize {
        match self {
            Self::Values => 1,
            Self::Derivatives => 3,
        }
    }
}

fn between<T: Number, F: Function>(
    function: F,
    products: &[T],
    bias: &[T],
    order: Order,
) -> Vec<T> {
    let mut outputs = vec![T::zero(); products.len()];
    Arch::new().dispatch(Between {
        function,
        products,
        bias,
        order,
        outputs: &mut outputs,
    });
    outputs
}

struct Between<'a, T, F> {
    function: F,
    products: &'a [T],
    bias: &'a [T],
    order: Order,
    outputs: &'a mut [T],
}

impl<T: Number, F: Function> WithSimd for Between<'_, T, F> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        match self.order {
            Order::Values => self.values(),
            Order::Derivatives => self.derivatives(),
        }
    }
}

impl<T: Number, F: Function> Between<'_, T, F> {
    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn values(self) {
        let width = self.bias.len();
        let rows = self.products.chunks_exact(width);
        for (row, outputs) in rows.zip(self.outputs.chunks_exact_mut(width)) {
            for ((&x, &bias), output) in row.iter().zip(self.bias).zip(outputs) {
                *output = self.function.value(x + bias);
            }
        }
    }

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn derivatives(self) {
        let width = self.bias.len();
        let block = self.products.len() / 3;
        let (values, rates) = self.products.split_at(block);
        let (firsts, seconds) = rates.split_at(block);
        let (to_values, to_rates) = self.outputs.split_at_mut(block);
        let (to_firsts, to_seconds) = to_rates.split_at_mut(block);
        let inputs = values
            .chunks_exact(width)
            .zip(firsts.chunks_exact(width))
            .zip(seconds.chunks_exact(width));
        let outputs = to_values
            .chunks_exact_mut(width)
            .zip(to_firsts.chunks_exact_mut(width))
            .zip(to_seconds.chunks_exact_mut(width));
        for (((x, first), second), ((to_x, to_first), to_second)) in inputs.zip(outputs) {
            jet(
                self.function,
                [x, first, second],
                self.bias,
                [to_x, to_first, to_second],
            );
        }
    }
}

/// One row of values and derivatives: as arguments of a function the slices are known not to overlap.
#[expect(
    clippy::inline_always,
    reason = "part of a loop for an instruction set"
)]
#[inline(always)]
fn jet<T: Number, F: Function>(
    function: F,
    [x, first, second]: [&[T]; 3],
    bias: &[T],
    [to_x, to_first, to_second]: [&mut [T]; 3],
) {
    let width = bias.len();
    let (x, first, second) = (&x[..width], &first[..width], &second[..width]);
    let to_x = &mut to_x[..width];
    let to_first = &mut to_first[..width];
    let to_second = &mut to_second[..width];
    for k in 0..width {
        let [value, slope, bend] = function.derivatives(x[k] + bias[k]);
        to_x[k] = value;
        to_first[k] = slope * first[k];
        to_second[k] = bend * first[k] * first[k] + slope * second[k];
    }
}

/// Takes what the first layer knows of each motion, `(motions, width)` with its bias, and times to the
/// layer's outputs, `(motions × times, width)` once or three times: the layer is linear in time, with
/// `per_time` as its rate.
pub(super) fn first_layer<T: Number>(
    activation: Activation,
    motions: &[T],
    per_time: &[T],
    times: &[T],
    order: Order,
    rows: usize,
) -> Vec<T> {
    match activation {
        Activation::Relu => start(Relu, motions, per_time, times, order, rows),
        Activation::Silu => start(Silu, motions, per_time, times, order, rows),
    }
}

fn start<T: Number, F: Function>(
    function: F,
    motions: &[T],
    per_time: &[T],
    times: &[T],
    order: Order,
    rows: usize,
) -> Vec<T> {
    let mut outputs = vec![T::zero(); order.blocks() * rows * per_time.len()];
    Arch::new().dispatch(Start {
        function,
        motions,
        per_time,
        times,
        order,
        rows,
        outputs: &mut outputs,
    });
    outputs
}

struct Start<'a, T, F> {
    function: F,
    motions: &'a [T],
    per_time: &'a [T],
    times: &'a [T],
    order: Order,
    /// Rows of a block, those beyond the motions' are left at zero.
    rows: usize,
    outputs: &'a mut [T],
}

impl<T: Number, F: Function> WithSimd for Start<'_, T, F> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let width = self.per_time.len();
        let (values, rates) = self.outputs.split_at_mut(self.rows * width);
        let mut values = values.chunks_exact_mut(width);
        let (firsts, seconds) = rates.split_at_mut(rates.len() / 2);
        let mut firsts = firsts.chunks_exact_mut(width);
        let mut seconds = seconds.chunks_exact_mut(width);
        for motion in self.motions.chunks_exact(width) {
            for (&time, to_value) in self.times.iter().zip(&mut values) {
                match self.order {
                    Order::Values => {
                        let parts = motion.iter().zip(self.per_time);
                        for ((&known, &rate), output) in parts.zip(to_value) {
                            *output = self.function.value(known + time * rate);
                        }
                    }
                    Order::Derivatives => {
                        let (Some(to_first), Some(to_second)) = (firsts.next(), seconds.next())
                        else {
                            return;
                        };
                        start_jet(
                            self.function,
                            [motion, self.per_time],
                            time,
                            [to_value, to_first, to_second],
                        );
                    }
                }
            }
        }
    }
}

/// One row of [`Start`] with derivatives: as arguments of a function the slices are known not to overlap.
#[expect(
    clippy::inline_always,
    reason = "part of a loop for an instruction set"
)]
#[inline(always)]
fn start_jet<T: Number, F: Function>(
    function: F,
    [motion, per_time]: [&[T]; 2],
    time: T,
    [to_x, to_first, to_second]: [&mut [T]; 3],
) {
    let width = per_time.len();
    let motion = &motion[..width];
    let to_x = &mut to_x[..width];
    let to_first = &mut to_first[..width];
    let to_second = &mut to_second[..width];
    for k in 0..width {
        let rate = per_time[k];
        let [value, slope, bend] = function.derivatives(motion[k] + time * rate);
        to_x[k] = value;
        to_first[k] = slope * rate;
        to_second[k] = bend * rate * rate;
    }
}

/// Adds the products of rows of inputs, `(rows, inputs)`, with a matrix, `(inputs, width)`, to `sums`,
/// `(rows, width)`: input by input, so that a sum does not depend on how many rows there are.
pub(super) fn add_product<T: Number>(sums: &mut [T], inputs: &[T], matrix: &[T], width: usize) {
    Arch::new().dispatch(AddProduct {
        sums,
        inputs,
        matrix,
        width,
    });
}

struct AddProduct<'a, T> {
    sums: &'a mut [T],
    inputs: &'a [T],
    matrix: &'a [T],
    width: usize,
}

impl<T: Number> WithSimd for AddProduct<'_, T> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "part of a loop for an instruction set"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n_inputs = self.matrix.len() / self.width;
        for (input, weights) in self.matrix.chunks_exact(self.width).enumerate() {
            let rows = self.inputs.chunks_exact(n_inputs);
            for (sums, inputs) in self.sums.chunks_exact_mut(self.width).zip(rows) {
                let by = inputs[input];
                for (sum, &weight) in sums.iter_mut().zip(weights) {
                    *sum += by * weight;
                }
            }
        }
    }
}
