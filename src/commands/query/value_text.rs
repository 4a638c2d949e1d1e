//! Single values as text.

use ::cell::escaped;
use datafusion::arrow::{
    array::{Array, AsArray},
    datatypes::{DataType, Float32Type, Float64Type, Int64Type},
    util::display::{ArrayFormatter, DurationFormat, FormatOptions},
};
use serde_json::Value;

use crate::numbers::number;

/// A value for display, on one line; lists are cut to this many elements.
pub(super) fn cell(column: &dyn Array, row: usize, elements: usize) -> String {
    if column.is_null(row) {
        return "-".to_owned();
    }
    match column.data_type() {
        DataType::Float32 => number(f64::from(column.as_primitive::<Float32Type>().value(row))),
        DataType::Float64 => number(column.as_primitive::<Float64Type>().value(row)),
        DataType::Binary => format!("{} bytes", column.as_binary::<i32>().value(row).len()),
        DataType::List(_) => {
            let items = column.as_list::<i32>().value(row);
            let shown = (0..items.len().min(elements)).map(|item| cell(&items, item, elements));
            let mut shown: Vec<String> = shown.collect();
            if items.len() > elements {
                shown.push(format!("… {} in all", items.len()));
            }
            format!("[{}]", shown.join(", "))
        }
        _ => escaped(&text(column, row)),
    }
}

/// The complete value, for programs. What is no number in JSON is text: `Infinity`, `-Infinity`, `NaN`.
pub(super) fn json(column: &dyn Array, row: usize) -> Value {
    if column.is_null(row) {
        return Value::Null;
    }
    match column.data_type() {
        DataType::Boolean => column.as_boolean().value(row).into(),
        DataType::Int64 => column.as_primitive::<Int64Type>().value(row).into(),
        DataType::Float32 => {
            // The digits of the shorter of the two types, so that none are invented.
            let value = column.as_primitive::<Float32Type>().value(row);
            decimal(value.to_string().parse().unwrap_or(f64::NAN))
        }
        DataType::Float64 => decimal(column.as_primitive::<Float64Type>().value(row)),
        DataType::List(_) => {
            let items = column.as_list::<i32>().value(row);
            (0..items.len()).map(|item| json(&items, item)).collect()
        }
        DataType::Struct(fields) => {
            let parts = column.as_struct();
            let values = fields.iter().zip(parts.columns());
            values
                .map(|(field, part)| (field.name().clone(), json(part, row)))
                .collect()
        }
        kind if kind.is_integer() => {
            let digits = text(column, row);
            serde_json::from_str(&digits).unwrap_or(Value::String(digits))
        }
        _ => text(column, row).into(),
    }
}

fn decimal(value: f64) -> Value {
    let no_number = if value.is_nan() {
        "NaN"
    } else if value > 0.0 {
        "Infinity"
    } else {
        "-Infinity"
    };
    if value.is_finite() {
        value.into()
    } else {
        no_number.into()
    }
}

/// A value as text for programs; times in ISO 8601.
pub(super) fn text(column: &dyn Array, row: usize) -> String {
    if column.is_null(row) {
        return String::new();
    }
    match column.data_type() {
        DataType::Utf8 => column.as_string::<i32>().value(row).to_owned(),
        DataType::Float32 => format!("{:?}", column.as_primitive::<Float32Type>().value(row)),
        DataType::Float64 => format!("{:?}", column.as_primitive::<Float64Type>().value(row)),
        DataType::List(_) | DataType::Struct(_) => json(column, row).to_string(),
        _ => {
            let options = FormatOptions::new().with_duration_format(DurationFormat::Pretty);
            let formatter = ArrayFormatter::try_new(column, &options);
            formatter.map_or_else(|_| String::new(), |cells| cells.value(row).to_string())
        }
    }
}

#[cfg(test)]
mod tests {
    use datafusion::arrow::{
        array::{Float32Array, Float64Array, ListArray, StringArray},
        datatypes::Int64Type,
    };

    use super::*;

    fn list(n: i64) -> ListArray {
        let items = (0..n).map(Some);
        ListArray::from_iter_primitive::<Int64Type, _, _>([Some(items)])
    }

    #[test]
    fn lists_show_their_first_elements_and_their_length() {
        let short =
            ListArray::from_iter_primitive::<Float64Type, _, _>([Some([Some(0.5), Some(1e-6)])]);
        assert_eq!(cell(&short, 0, 8), "[0.5, 1e-6]");
        let text = cell(&list(20), 0, 8);
        assert!(text.ends_with("6, 7, … 20 in all]"), "{text}");
    }

    #[test]
    fn text_stays_on_its_line() {
        let texts = StringArray::from(vec!["a\nb\u{1b}[0m", "\u{202e}pots"]);
        assert_eq!(cell(&texts, 0, 8), "a\\nb\\u{1b}[0m");
        assert_eq!(cell(&texts, 1, 8), "\\u{202e}pots");
    }

    #[test]
    fn json_has_every_element() {
        let text = json(&list(20), 0).to_string();
        assert!(
            text.starts_with("[0,1,") && text.ends_with(",19]"),
            "{text}"
        );
        assert_eq!(json(&Float32Array::from(vec![0.1]), 0).to_string(), "0.1");
    }

    #[test]
    fn what_is_no_number_in_json_is_text() {
        let values = Float64Array::from(vec![f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e300]);
        let texts: Vec<String> = (0..4).map(|row| json(&values, row).to_string()).collect();
        assert_eq!(
            texts,
            ["\"Infinity\"", "\"-Infinity\"", "\"NaN\"", "1e+300"]
        );
    }
}
