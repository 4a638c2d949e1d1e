//! Numbers as people read them.

/// Returns a share in percent, to one decimal.
pub(crate) fn percent(share: f64) -> String {
    format!("{:.1}\u{a0}%", 100.0 * share)
}

/// Returns a whole number with thin spaces between thousands.
pub(crate) fn count(n: i64) -> String {
    let digits = n.unsigned_abs().to_string();
    let mut text = String::new();
    for (idx, digit) in digits.chars().enumerate() {
        if idx > 0 && (digits.len() - idx).is_multiple_of(3) && digits.len() > 4 {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    if n < 0 { format!("−{text}") } else { text }
}

/// Returns a count of things in memory.
pub(crate) fn signed(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

/// Returns a time as minutes and seconds.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let minutes = (seconds / 60.0).floor();
    format!(
        "{minutes:.0} min {:02.0} s",
        (seconds - 60.0 * minutes).floor()
    )
}

/// Returns a plain name of a table's word: `knocked_over` is `knocked over`.
pub(crate) fn words(word: &str) -> String {
    word.replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_rounded_and_signed() {
        for (n, expected) in [
            (0, "0"),
            (-7, "−7"),
            (3840, "3840"),
            (1_234_567, "1\u{202f}234\u{202f}567"),
        ] {
            assert_eq!(count(n), expected);
        }
        assert_eq!(percent(0.916), "91.6\u{a0}%");
        assert_eq!(
            (duration(3.04), duration(85.9)),
            ("3.0 s".to_owned(), "1 min 25 s".to_owned())
        );
    }
}
