//! Numbers for display.

/// Significant digits shown.
const DIGITS: i32 = 6;

/// A number with six significant digits; very large and small ones with an exponent.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    if !(1e-4..1e9).contains(&size) {
        let text = format!("{value:.5e}");
        return match text.split_once('e') {
            Some((digits, exponent)) => format!("{}e{exponent}", without_zeros(digits)),
            None => text,
        };
    }
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the size has been bounded above"
    )]
    let leading = size.log10().floor() as i32;
    let decimals = usize::try_from(DIGITS - 1 - leading).unwrap_or(0);
    without_zeros(&format!("{value:.decimals$}")).to_owned()
}

/// Digits without trailing zeros of a fraction.
fn without_zeros(digits: &str) -> &str {
    if digits.contains('.') {
        digits.trim_end_matches('0').trim_end_matches('.')
    } else {
        digits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_six_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-12.5, "-12.5"),
            (0.1 + 0.2, "0.3"),
            (1.0 / 3.0, "0.333333"),
            (2e-4, "0.0002"),
            (1e-6, "1e-6"),
            (-1.234_567_8e-9, "-1.23457e-9"),
            (123_456_789.0, "123456789"),
            (1.5e12, "1.5e12"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
