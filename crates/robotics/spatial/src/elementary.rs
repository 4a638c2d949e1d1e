//! Sine, exponential, logarithm and the like, equal to the bit on every processor.
//!
//! The C library chooses its own at runtime by the processor's instructions, and their last bits differ. These take their
//! place: a program's own symbol goes before one of a shared library, so that `f64::sin` and the calls of every dependency
//! end here. The functions are those of the crate `libm`, in plain Rust. The compiler computes square roots, rounding and
//! fused products without a library, or exactly.

#![expect(
    unsafe_code,
    reason = "a symbol takes the place of another, and the C interface of `sincos` has pointers"
)]

macro_rules! in_place_of_c {
    ($($name:ident($($x:ident),+): $number:ty;)+) => {
        $(
            // SAFETY: arguments and result are those of the C library's function of this name.
            #[unsafe(no_mangle)]
            extern "C" fn $name($($x: $number),+) -> $number {
                libm::$name($($x),+)
            }
        )+
    };
}

in_place_of_c! {
    acos(x): f64;
    acosh(x): f64;
    asin(x): f64;
    asinh(x): f64;
    atan(x): f64;
    atan2(y, x): f64;
    atanh(x): f64;
    cbrt(x): f64;
    cos(x): f64;
    cosh(x): f64;
    exp(x): f64;
    exp2(x): f64;
    expm1(x): f64;
    hypot(x, y): f64;
    log(x): f64;
    log10(x): f64;
    log1p(x): f64;
    log2(x): f64;
    pow(x, y): f64;
    sin(x): f64;
    sinh(x): f64;
    tan(x): f64;
    tanh(x): f64;
    acosf(x): f32;
    acoshf(x): f32;
    asinf(x): f32;
    asinhf(x): f32;
    atanf(x): f32;
    atan2f(y, x): f32;
    atanhf(x): f32;
    cbrtf(x): f32;
    cosf(x): f32;
    coshf(x): f32;
    exp2f(x): f32;
    expm1f(x): f32;
    hypotf(x, y): f32;
    logf(x): f32;
    log10f(x): f32;
    log1pf(x): f32;
    log2f(x): f32;
    powf(x, y): f32;
    sinf(x): f32;
    sinhf(x): f32;
    tanf(x): f32;
    tanhf(x): f32;
}

/// The exponential in `f64`, rounded: 2^k e^r, with e^r by its series. Faster than that of `libm`, and training takes
/// many.
// SAFETY: argument and result are those of the C library's function of this name.
#[unsafe(no_mangle)]
#[expect(
    clippy::cast_possible_truncation,
    reason = "the result has half the precision"
)]
extern "C" fn expf(x: f32) -> f32 {
    /// Added, it leaves a whole number in the last bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// 1/n! from n = 9 to 0.
    const SERIES: [f64; 10] = [
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        1.0 / 2.0,
        1.0,
        1.0,
    ];
    // Beyond these bounds the result is 0 or infinite. NaN stays NaN.
    let x = f64::from(x).clamp(-104.0, 89.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let r = x - (shifted - ROUND) * std::f64::consts::LN_2;
    let power = SERIES.iter().fold(0.0, |sum, factor| sum * r + factor);
    let two_to_k = f64::from_bits((shifted.to_bits() + 1023) << 52);
    (power * two_to_k) as f32
}

// SAFETY: arguments are those of the C library's function of this name.
#[unsafe(no_mangle)]
unsafe extern "C" fn sincos(x: f64, sin: *mut f64, cos: *mut f64) {
    // SAFETY: the caller gives two places for numbers, as in C.
    unsafe {
        *sin = libm::sin(x);
        *cos = libm::cos(x);
    }
}

// SAFETY: arguments are those of the C library's function of this name.
#[unsafe(no_mangle)]
unsafe extern "C" fn sincosf(x: f32, sin: *mut f32, cos: *mut f32) {
    // SAFETY: the caller gives two places for numbers, as in C.
    unsafe {
        *sin = libm::sinf(x);
        *cos = libm::cosf(x);
    }
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    #[test]
    fn the_exponential_is_rounded_rightly() {
        let bounds = [
            f32::MAX,
            f32::MIN,
            88.7,
            88.73,
            -87.4,
            -103.9,
            -104.1,
            0.0,
            -0.0,
        ];
        let steps = (-104_000..89_000).map(|step| step as f32 * 1e-3);
        for x in steps.chain(bounds).map(black_box) {
            let exact = libm::exp(f64::from(x));
            // Half a unit in the last place, or of the least number, and a thousandth for ties.
            let unit = f64::from((exact as f32).next_up()) - f64::from(exact as f32);
            let off = (f64::from(x.exp()) - exact).abs();
            assert!(off <= 0.501 * unit || x.exp() == exact as f32, "{x}");
        }
        assert!(black_box(f32::NAN).exp().is_nan());
        assert_eq!(black_box(f32::INFINITY).exp(), f32::INFINITY);
        assert_eq!(black_box(f32::NEG_INFINITY).exp(), 0.0);
    }

    #[test]
    fn functions_of_numbers_are_these() {
        for step in -2000..2000 {
            let x = black_box(f64::from(step) * 0.01);
            assert_eq!(x.sin().to_bits(), libm::sin(x).to_bits());
            assert_eq!(x.cos().to_bits(), libm::cos(x).to_bits());
            assert_eq!(x.sin_cos(), (libm::sin(x), libm::cos(x)));
            assert_eq!(x.tan().to_bits(), libm::tan(x).to_bits());
            assert_eq!(x.exp().to_bits(), libm::exp(x).to_bits());
            assert_eq!(x.atan2(0.3).to_bits(), libm::atan2(x, 0.3).to_bits());
            let positive = x.abs() + 0.01;
            assert_eq!(positive.ln().to_bits(), libm::log(positive).to_bits());
            assert_eq!(
                positive.powf(0.7).to_bits(),
                libm::pow(positive, 0.7).to_bits()
            );
            let x = black_box(x as f32);
            assert_eq!(x.sin().to_bits(), libm::sinf(x).to_bits());
            assert_eq!(x.sin_cos(), (libm::sinf(x), libm::cosf(x)));
            assert_eq!(x.tanh().to_bits(), libm::tanhf(x).to_bits());
        }
    }
}
