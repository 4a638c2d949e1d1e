//! The two kinds of numbers that the decoder computes with, and their exponential function.

use candle_core::WithDType;

use crate::product::{self, PackedMatrix, Row, Sparse};

/// `f32` as the network computes, `f64` to check it.
pub(crate) trait Number: WithDType + Default {
    /// Returns eˣ without a branch or a call, so that a loop of it fills a processor's vectors.
    ///
    /// With x = n ln 2 + r, |r| ≤ ln 2 / 2, it is 2ⁿ times the series of eʳ, which is cut where it no
    /// longer shows (W. J. Cody and W. Waite, *Software Manual for the Elementary Functions*, 1980,
    /// chapter 6): correct to two units in the last place between the least and the greatest argument
    /// whose result is a normal number, and constant beyond them.
    fn exp(self) -> Self;

    /// Whether all numbers are zero.
    fn are_zero(row: &Row<Self>) -> bool;

    /// Sets `out`, patch after patch, to the products of a matrix with patches, plus `offset` of each
    /// output.
    fn project(
        weights: &PackedMatrix<Self>,
        patches: &[Sparse<Self>],
        offset: &[Self],
        out: &mut [Row<Self>],
    );
}

macro_rules! number {
    (
        $number:ty, least: $least:literal, greatest: $greatest:literal, to_integer: $to_integer:literal,
        log2_e: $log2_e:expr, ln_2: $high:literal + $low:literal, one: $one:literal, mantissa_bits: $bits:literal,
        series: [$last:literal $(, $term:literal)*], project: $project:path
    ) => {
        impl Number for $number {
            // It must become part of the loop that is compiled for an instruction set.
            #[inline(always)]
            fn exp(self) -> Self {
                // Comparisons keep NaN.
                let x = if self < $least { $least } else { self };
                let x = if x > $greatest { $greatest } else { x };
                // A number so large has no digits after the point: adding it rounds, and leaves n in
                // the lowest bits.
                let shifted: Self = x * $log2_e + $to_integer;
                let n = shifted - $to_integer;
                let r = x - n * $high - n * $low;
                let mut series: Self = $last;
                $(series = series * r + $term;)*
                let power = Self::from_bits((shifted.to_bits() << $bits).wrapping_add($one));
                series * power
            }

            #[inline(always)]
            fn are_zero(row: &Row<Self>) -> bool {
                row.iter().fold(0, |bits, x| bits | (x.to_bits() << 1)) == 0
            }

            fn project(
                weights: &PackedMatrix<Self>,
                patches: &[Sparse<Self>],
                offset: &[Self],
                out: &mut [Row<Self>],
            ) {
                $project(weights, patches, offset, out);
            }
        }
    };
}

number! {
    f32, least: -87.0, greatest: 88.0, to_integer: 12_582_912.0,
    log2_e: std::f32::consts::LOG2_E, ln_2: 0.693_359_4 + -2.121_944_4e-4, one: 0x3f80_0000,
    mantissa_bits: 23,
    series: [
        1.984_127e-4, 1.388_888_9e-3, 8.333_334e-3, 4.166_666_8e-2, 1.666_666_7e-1, 0.5, 1.0, 1.0
    ],
    project: product::project
}

number! {
    f64, least: -708.0, greatest: 709.0, to_integer: 6_755_399_441_055_744.0,
    log2_e: std::f64::consts::LOG2_E, ln_2: 0.693_147_180_369_123_8 + 1.908_214_929_270_587_7e-10, one: 0x3ff0_0000_0000_0000,
    mantissa_bits: 52,
    series: [
        1.605_904_383_682_161_3e-10, 2.087_675_698_786_81e-9, 2.505_210_838_544_172e-8,
        2.755_731_922_398_589_3e-7, 2.755_731_922_398_589e-6, 2.480_158_730_158_73e-5,
        1.984_126_984_126_984e-4, 1.388_888_888_888_889e-3, 8.333_333_333_333_333e-3,
        4.166_666_666_666_666_4e-2, 1.666_666_666_666_666_6e-1, 0.5, 1.0, 1.0
    ],
    project: product::project_plainly
}

#[cfg(test)]
mod tests {
    use super::Number;

    #[test]
    fn the_exponential_function_is_right_to_the_last_digits() {
        let (mut worst_32, mut worst_64) = (0.0_f64, 0.0_f64);
        for k in -700_000..700_000 {
            let x = f64::from(k) * 1e-3 + 1e-5;
            let ratio = Number::exp(x) / x.exp();
            worst_64 = worst_64.max((ratio - 1.0).abs());
            let x = x as f32 * 0.124;
            let ratio = f64::from(Number::exp(x)) / f64::from(x).exp();
            worst_32 = worst_32.max((ratio - 1.0).abs());
        }
        assert!(worst_32 < 2.4e-7, "{worst_32}");
        assert!(worst_64 < 5e-16, "{worst_64}");
    }

    #[test]
    fn nan_stays_nan_and_extremes_are_finite() {
        assert!(Number::exp(f32::NAN).is_nan() && Number::exp(f64::NAN).is_nan());
        for x in [-1e30_f32, 1e30, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(Number::exp(x).is_finite());
        }
        assert!(Number::exp(-1e300_f64) < 1e-300 && Number::exp(1e300_f64) > 1e300);
    }
}
