//! Sines and cosines of many angles at once.

use std::f64::consts::FRAC_2_PI;

/// Added and taken away again, this rounds to a whole number: 1.5 × 2⁵².
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Beyond this angle the reduction below loses digits, in radians.
const MAX_ANGLE: f64 = 1e5;
/// π/2 in three parts, the first two with trailing zeros, so that small multiples are exact (Cody
/// and Waite, *Software Manual for the Elementary Functions*, 1980, §8.1; the parts are fdlibm's).
const HALF_PI: [f64; 3] = [
    1.570_796_326_734_125_6,
    6.077_100_506_303_966e-11,
    2.022_266_248_795_950_6e-21,
];
/// Minimax polynomials of sine and cosine on ±π/4, from fdlibm's `k_sin.c` and `k_cos.c` (Sun
/// Microsystems, 1993), highest power last.
const SINE: [f64; 6] = [
    -0.166_666_666_666_666_32,
    0.008_333_333_333_322_49,
    -0.000_198_412_698_298_579_5,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const COSINE: [f64; 6] = [
    0.041_666_666_666_666_6,
    -0.001_388_888_888_887_411,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Angles that are worked on at once.
pub(crate) const LANES: usize = 4;

/// Writes the sine and cosine of each angle (rad), right to two units in the last place.
///
/// The work has no branch, so that the compiler does several angles at once, and it does not call
/// the platform's library, so that every machine gets the same bits.
pub(crate) fn sin_cos(angles: &[f64], sines: &mut [f64], cosines: &mut [f64]) {
    let (mut angle_chunks, mut sine_chunks) =
        (angles.chunks_exact(LANES), sines.chunks_exact_mut(LANES));
    let mut cosine_chunks = cosines.chunks_exact_mut(LANES);
    for ((angles, sines), cosines) in (&mut angle_chunks)
        .zip(&mut sine_chunks)
        .zip(&mut cosine_chunks)
    {
        let (s, c) = lanes([angles[0], angles[1], angles[2], angles[3]]);
        sines.copy_from_slice(&s);
        cosines.copy_from_slice(&c);
    }
    let rest = angle_chunks.remainder();
    if !rest.is_empty() {
        let mut padded = [0.0; LANES];
        padded[..rest.len()].copy_from_slice(rest);
        let (s, c) = lanes(padded);
        sine_chunks
            .into_remainder()
            .copy_from_slice(&s[..rest.len()]);
        cosine_chunks
            .into_remainder()
            .copy_from_slice(&c[..rest.len()]);
    }
}

#[inline]
fn lanes(angles: [f64; LANES]) -> ([f64; LANES], [f64; LANES]) {
    let (mut sines, mut cosines) = ([0.0; LANES], [0.0; LANES]);
    let mut largest: f64 = 0.0;
    for lane in 0..LANES {
        let angle = angles[lane];
        largest = largest.max(angle.abs());
        let shifted = angle * FRAC_2_PI + ROUND;
        let turns = shifted - ROUND;
        let x = ((angle - turns * HALF_PI[0]) - turns * HALF_PI[1]) - turns * HALF_PI[2];
        let z = x * x;
        let s = SINE[4] + z * SINE[5];
        let s = SINE[0] + z * (SINE[1] + z * (SINE[2] + z * (SINE[3] + z * s)));
        let s = x + x * z * s;
        let c = COSINE[4] + z * COSINE[5];
        let c = COSINE[0] + z * (COSINE[1] + z * (COSINE[2] + z * (COSINE[3] + z * c)));
        let c = 1.0 - 0.5 * z + z * z * c;
        // The lowest bits of the shifted number count quarter turns.
        let quarter = shifted.to_bits();
        let swap = (quarter & 1).wrapping_neg();
        let (s_bits, c_bits) = (s.to_bits(), c.to_bits());
        let sine_bits = (s_bits & !swap) | (c_bits & swap);
        let cosine_bits = (c_bits & !swap) | (s_bits & swap);
        sines[lane] = f64::from_bits(sine_bits ^ ((quarter & 2) << 62));
        cosines[lane] = f64::from_bits(cosine_bits ^ ((quarter.wrapping_add(1) & 2) << 62));
    }
    if largest > MAX_ANGLE {
        for lane in 0..LANES {
            (sines[lane], cosines[lane]) = angles[lane].sin_cos();
        }
    }
    (sines, cosines)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn agrees_with_the_library(angle in prop_oneof![-7.0..7.0, -9e4..9e4, -1e9..1e9]) {
            let (mut sine, mut cosine) = ([0.0], [0.0]);
            sin_cos(&[angle], &mut sine, &mut cosine);
            // Near a multiple of π/2 the absolute error is that of the reduction.
            prop_assert!((sine[0] - angle.sin()).abs() < 5e-16, "{angle}");
            prop_assert!((cosine[0] - angle.cos()).abs() < 5e-16, "{angle}");
        }
    }

    #[test]
    fn quarter_turns_are_exact() {
        let (mut sine, mut cosine) = ([0.0; 3], [0.0; 3]);
        sin_cos(&[0.0, -0.0, f64::NAN], &mut sine, &mut cosine);
        assert_eq!((sine[0], cosine[0], cosine[1]), (0.0, 1.0, 1.0));
        assert!(sine[2].is_nan());
    }
}
