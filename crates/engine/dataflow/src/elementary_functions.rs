//! How the C library rounds elementary functions on this processor.
//!
//! Sine, exponential and their like are not correctly rounded: the library rounds up to one result in 1,000
//! otherwise where a processor has no fused multiply-add, and another library may do so anywhere. Results that depend
//! on it are never mixed with others: units made so have another fingerprint.

use std::hint::black_box;

use crate::digest::Digest;

/// Their name among the parts of a fingerprint's code.
pub(crate) const PART: &str = "elementary functions";

/// A function of one argument with the bits of an argument and of its usual value: of glibc 2.36 on processors with
/// fused multiply-add. Without it glibc gives another value for each.
type OfOne = (fn(f64) -> f64, u64, u64);

/// A function of two arguments with the bits of both and of its usual value.
type OfTwo = (fn(f64, f64) -> f64, u64, u64, u64);

const OF_ONE: [OfOne; 28] = [
    (f64::sin, 0xc00f_5872_6f72_83ce, 0x3fe6_6d65_db48_6973),
    (f64::sin, 0xbff0_d966_302d_60ec, 0xbfeb_ce6f_7606_6580),
    (f64::cos, 0x4011_c334_5380_d134, 0xbfd1_2de8_40b2_334e),
    (f64::cos, 0xbfff_94b7_82ce_abd8, 0xbfd9_19a5_867d_b212),
    (f64::tan, 0xbfac_6dc8_5791_5700, 0xbfac_7545_62bf_7533),
    (f64::tan, 0xc019_5408_b53c_0008, 0xbfa9_0bcb_e76b_ca01),
    (f64::asin, 0xbfc0_6119_2507_f888, 0xbfc0_6ca0_7259_8806),
    (f64::asin, 0xbfb1_8650_d204_2d50, 0xbfb1_89d3_babe_d69b),
    (f64::acos, 0x3fe7_76d5_a3be_3764, 0x3fe7_ed24_06b6_51a3),
    (f64::acos, 0x3fee_bec6_c6ac_14ca, 0x3fd1_fb57_1c85_7ad2),
    (f64::atan, 0xbffe_6cec_8291_c494, 0xbff1_62f9_7141_9432),
    (f64::atan, 0xbfd0_1c0a_f2c9_b160, 0xbfcf_9039_d616_2553),
    (f64::exp, 0x4000_fe66_9177_1a78, 0x4020_bb93_b8b7_2551),
    (f64::exp, 0xbfcd_0c9f_57f6_79c0, 0x3fe9_80b7_6957_a5b3),
    (f64::ln, 0x3fe8_e3ed_b38a_fd98, 0xbfd0_1493_99eb_9e5d),
    (f64::ln, 0x403f_872f_8065_49f8, 0x400b_9b66_0993_77b5),
    (f64::log2, 0x400b_89b1_073e_0fee, 0x3ffc_8894_26d9_764b),
    (f64::log2, 0x4022_dba4_ac23_5d64, 0x4009_e596_7174_79e3),
    (f64::log10, 0x3fec_9eb2_5658_8f22, 0xbfa8_d299_0d5e_35e6),
    (f64::log10, 0x4046_86f8_6299_d9c1, 0x3ffa_75b5_b4cd_98c5),
    (f64::ln_1p, 0x3fd0_33a6_f7ab_604a, 0x3fcc_e281_e494_d2b0),
    (f64::ln_1p, 0x3ffd_8e43_888e_08aa, 0x3ff0_bdd6_cc4b_c364),
    (f64::sinh, 0xbff1_db49_b1d0_b694, 0xbff5_cd1f_2746_0088),
    (f64::sinh, 0x3fc1_ead5_9913_cc20, 0x3fc1_f9d4_06da_0e9d),
    (f64::cosh, 0x400b_28ff_2a6c_1760, 0x402d_d946_421e_7719),
    (f64::cosh, 0xbff4_6d36_1c91_7454, 0x3ffe_e8b3_cb6a_0cd2),
    (f64::tanh, 0xbfc9_4d21_5daf_c1c0, 0xbfc8_fa11_f3ce_86f2),
    (f64::tanh, 0xbfc3_5a5b_e85d_1980, 0xbfc3_34f2_ed9a_4f31),
];

const OF_TWO: [OfTwo; 4] = [
    (
        f64::powf,
        0x4012_c594_45a3_eace,
        0x4017_b54e_979c_0896,
        0x40c2_a3a4_4fc9_6edb,
    ),
    (
        f64::powf,
        0x3ffb_4798_caa8_5e56,
        0xc01c_8730_2b0f_5a6f,
        0x3f96_c94b_85e6_1657,
    ),
    (
        f64::atan2,
        0xc006_1cf2_49db_cb60,
        0x4003_e134_88b3_4584,
        0xbfea_d542_488c_7d16,
    ),
    (
        f64::atan2,
        0x400f_4931_926e_5070,
        0x4018_7567_7c09_6464,
        0x3fe2_354e_2dc8_dc97,
    ),
];

/// Returns a digest of the values here; `None` if all are the usual ones.
pub(crate) fn unusual() -> Option<Digest> {
    let of_one = OF_ONE.map(|(function, x, usual)| (value(function, x), usual));
    let of_two = OF_TWO.map(|(function, x, y, usual)| {
        let of_x = |y| function(black_box(f64::from_bits(x)), y);
        (value(of_x, y), usual)
    });
    differing(of_one.into_iter().chain(of_two))
}

/// Evaluates while the program runs: the compiler's own library is another one.
fn value(function: impl Fn(f64) -> f64, x: u64) -> u64 {
    function(black_box(f64::from_bits(x))).to_bits()
}

/// Returns a digest of values, each beside the usual one; `None` if they are equal.
fn differing(values: impl Iterator<Item = (u64, u64)>) -> Option<Digest> {
    let (here, usual): (Vec<_>, Vec<_>) = values.unzip();
    let bytes: Vec<u8> = here.iter().flat_map(|value| value.to_le_bytes()).collect();
    (here != usual).then(|| Digest::of_bytes(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_other_bit_gives_a_digest_of_its_own() {
        let usual = [1, 2, 3].map(|value| (value, value));
        assert_eq!(differing(usual.into_iter()), None);
        let [mut second, mut third] = [usual; 2];
        second[1].0 ^= 1;
        third[2].0 ^= 1;
        let [second, third] = [second, third].map(|values| differing(values.into_iter()));
        assert!(second.is_some() && third.is_some() && second != third);
    }
}
