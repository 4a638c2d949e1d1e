//! Text of other parties, for one line that people read.

/// Longest text shown, in characters.
const LONGEST: usize = 500;
/// Largest magnitude of a number that is written out in digits.
const LARGEST: f64 = 1e15;

/// Returns the start of text as [`escaped`] has it.
pub(crate) fn plain_line(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", escaped(text.get(..end).unwrap_or_default())),
        None => escaped(text),
    }
}

/// Returns text as one line without characters that move a cursor, are invisible or turn the direction of
/// writing: these are written as escapes.
pub fn escaped(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        // Quotes and backslashes have escapes too, and are harmless.
        if matches!(c, '"' | '\'' | '\\') {
            line.push(c);
        } else {
            line.extend(c.escape_debug());
        }
    }
    line
}

/// Returns a number in at most a line: a huge one with an exponent.
pub(crate) fn number(number: f64) -> String {
    if number.abs() < LARGEST {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

/// Returns a number in at most a line, with four decimals or an exponent.
pub(crate) fn rounded(number: f64) -> String {
    if number.abs() < LARGEST {
        format!("{number:.4}")
    } else {
        format!("{number:.4e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_others_stays_on_its_line_and_in_its_direction() {
        for (text, shown) in [
            ("it's a \"can\" \\ größer", "it's a \"can\" \\ größer"),
            ("a\nb\u{1b}[0m", "a\\nb\\u{1b}[0m"),
            ("\u{202e}nekorb\u{202c}", "\\u{202e}nekorb\\u{202c}"),
            ("a\u{200b}b\u{2066}", "a\\u{200b}b\\u{2066}"),
        ] {
            assert_eq!(plain_line(text), shown);
        }
        assert_eq!(
            plain_line(&"x".repeat(100_000)).chars().count(),
            LONGEST + 1
        );
    }

    #[test]
    fn huge_numbers_have_an_exponent() {
        assert_eq!(
            [1e300, -5.0, 0.25, 1e308].map(number),
            ["1e300", "-5", "0.25", "1e308"]
        );
        assert_eq!([1e300, 0.25].map(rounded), ["1.0000e300", "0.2500"]);
    }
}
