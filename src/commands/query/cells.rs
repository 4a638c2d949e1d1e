//! Single values as text.

use ::cell::escaped;
use polars::prelude::*;

use crate::numbers::number;

/// A value for display, on one line; lists are cut to this many elements.
pub(super) fn cell(value: &AnyValue, elements: usize) -> String {
    match value {
        AnyValue::Null => "-".to_owned(),
        AnyValue::String(text) => escaped(text),
        AnyValue::StringOwned(text) => escaped(text),
        AnyValue::Float32(value) => number(f64::from(*value)),
        AnyValue::Float64(value) => number(*value),
        AnyValue::Binary(bytes) => format!("{} bytes", bytes.len()),
        AnyValue::BinaryOwned(bytes) => format!("{} bytes", bytes.len()),
        AnyValue::List(values) | AnyValue::Array(values, _) => list(values, elements),
        other => escaped(&other.to_string()),
    }
}

/// The complete value, for programs.
pub(super) fn json(value: &AnyValue) -> serde_json::Value {
    match value {
        AnyValue::Null => serde_json::Value::Null,
        AnyValue::Boolean(value) => (*value).into(),
        // Written as the shorter of the two types, so that no digits are invented.
        AnyValue::Float32(value) => value
            .to_string()
            .parse::<f64>()
            .map_or_else(|_| serde_json::Value::Null, serde_json::Value::from),
        AnyValue::Float64(value) => (*value).into(),
        AnyValue::UInt64(value) => (*value).into(),
        AnyValue::List(values) | AnyValue::Array(values, _) => {
            values.iter().map(|value| json(&value)).collect()
        }
        AnyValue::Struct(..) | AnyValue::StructOwned(_) => object(value),
        other => match (other.extract::<i64>(), other.is_integer()) {
            (Some(whole), true) => whole.into(),
            _ => text(other).into(),
        },
    }
}

/// The fields of a structure by name.
fn object(value: &AnyValue) -> serde_json::Value {
    let AnyValue::StructOwned(parts) = value.clone().into_static() else {
        return serde_json::Value::Null;
    };
    let (values, fields) = *parts;
    let named = fields.iter().zip(&values);
    named
        .map(|(field, value)| (field.name().to_string(), json(value)))
        .collect()
}

/// A value as text for programs; times in ISO 8601.
pub(super) fn text(value: &AnyValue) -> String {
    match value {
        AnyValue::Null => String::new(),
        AnyValue::String(text) => (*text).to_owned(),
        AnyValue::StringOwned(text) => text.to_string(),
        AnyValue::Datetime(..) | AnyValue::DatetimeOwned(..) => {
            value.to_string().replacen(' ', "T", 1)
        }
        AnyValue::List(_)
        | AnyValue::Array(..)
        | AnyValue::Struct(..)
        | AnyValue::StructOwned(_) => json(value).to_string(),
        other => other.to_string(),
    }
}

fn list(values: &Series, elements: usize) -> String {
    let mut shown: Vec<String> = values
        .iter()
        .take(elements)
        .map(|value| cell(&value, elements))
        .collect();
    if values.len() > elements {
        shown.push(format!("… {} in all", values.len()));
    }
    format!("[{}]", shown.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_show_their_first_elements_and_their_length() {
        let short = Series::new("a".into(), [0.5, 1e-6]);
        assert_eq!(cell(&AnyValue::List(short), 8), "[0.5, 1e-6]");
        let long = Series::new("a".into(), (0..20).collect::<Vec<i64>>());
        let text = cell(&AnyValue::List(long), 8);
        assert!(text.ends_with("6, 7, … 20 in all]"), "{text}");
    }

    #[test]
    fn text_stays_on_its_line() {
        assert_eq!(
            cell(&AnyValue::String("a\nb\u{1b}[0m"), 8),
            "a\\nb\\u{1b}[0m"
        );
        assert_eq!(cell(&AnyValue::String("\u{202e}pots"), 8), "\\u{202e}pots");
    }

    #[test]
    fn json_has_every_element() {
        let long = Series::new("a".into(), (0..20).collect::<Vec<i64>>());
        let text = json(&AnyValue::List(long)).to_string();
        assert!(
            text.starts_with("[0,1,") && text.ends_with(",19]"),
            "{text}"
        );
        let single = json(&AnyValue::Float32(0.1));
        assert_eq!(single.to_string(), "0.1");
    }
}
