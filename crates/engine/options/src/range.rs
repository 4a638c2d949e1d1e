//! Ranges of options, in faults and in schemas.

use std::{
    fmt::Display,
    ops::{Bound, RangeBounds},
};

use schemars::Schema;
use serde::Serialize;
use serde_json::Value;

/// Returns the range of numbers above `bound`, up to `most`.
pub fn above<N>(bound: N, most: N) -> (Bound<N>, Bound<N>) {
    (Bound::Excluded(bound), Bound::Included(most))
}

/// Describes a range, to be read after `must be`.
pub(crate) fn words<N: Display>(range: &impl RangeBounds<N>) -> String {
    let least = match range.start_bound() {
        Bound::Included(least) => format!("from {least}"),
        Bound::Excluded(bound) => format!("more than {bound}"),
        Bound::Unbounded => String::new(),
    };
    let most = match (range.start_bound(), range.end_bound()) {
        (Bound::Included(_), Bound::Included(most)) => format!(" to {most}"),
        (Bound::Included(_), Bound::Excluded(bound)) => format!(" to below {bound}"),
        (Bound::Excluded(_), Bound::Included(most)) => format!(" and at most {most}"),
        (Bound::Excluded(_), Bound::Excluded(bound)) => format!(" and below {bound}"),
        (Bound::Unbounded, Bound::Included(most)) => format!("at most {most}"),
        (Bound::Unbounded, Bound::Excluded(bound)) => format!("below {bound}"),
        (Bound::Included(_), Bound::Unbounded) => " on".to_owned(),
        (_, Bound::Unbounded) => String::new(),
    };
    least + &most
}

/// Describes the range in a JSON schema, to be read after `must be`; `None` if it has none.
pub fn range_in(schema: &Value) -> Option<String> {
    // As faults write numbers: 0, not 0.0.
    let number = |key: &str| {
        let number = schema.get(key)?;
        let float = number.as_f64().filter(|_| number.is_f64());
        Some(float.map_or_else(|| number.to_string(), |float| float.to_string()))
    };
    let bound = |included: &str, excluded: &str| match (number(included), number(excluded)) {
        (Some(number), _) => Bound::Included(number),
        (None, Some(number)) => Bound::Excluded(number),
        (None, None) => Bound::Unbounded,
    };
    let range = (
        bound("minimum", "exclusiveMinimum"),
        bound("maximum", "exclusiveMaximum"),
    );
    let range = words(&range);
    (!range.is_empty()).then_some(range)
}

/// Adds an option's range to its schema, by JSON schema's words, and as `why` the reason for it.
pub fn describe<N: Serialize>(schema: &mut Schema, range: &impl RangeBounds<N>, why: &str) {
    let mut add = |included: &str, excluded: &str, bound: Bound<&N>| {
        let (key, number) = match bound {
            Bound::Included(number) => (included, number),
            Bound::Excluded(number) => (excluded, number),
            Bound::Unbounded => return,
        };
        if let Ok(number) = serde_json::to_value(number) {
            schema.insert(key.to_owned(), number);
        }
    };
    add("minimum", "exclusiveMinimum", range.start_bound());
    add("maximum", "exclusiveMaximum", range.end_bound());
    schema.insert("why".to_owned(), why.into());
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_range_reads_alike_in_faults_and_schemas() {
        fn check(range: &(impl RangeBounds<f64> + Clone), expected: &str) {
            let mut schema = Schema::default();
            describe(&mut schema, range, "");
            let in_schema = range_in(schema.as_value());
            assert_eq!(words(range), expected);
            assert_eq!(in_schema.unwrap_or_default(), expected);
        }
        check(&(0.0..=1.5), "from 0 to 1.5");
        check(&(0.0..1.0), "from 0 to below 1");
        check(&above(0.0, 3600.0), "more than 0 and at most 3600");
        check(&(0.0..), "from 0 on");
        check(&(..=2.0), "at most 2");
        check(&.., "");
        let whole = json!({"type": "integer", "minimum": 1, "maximum": 1_000_000});
        assert_eq!(range_in(&whole).unwrap(), "from 1 to 1000000");
        assert_eq!(range_in(&json!({"type": "number"})), None);
    }
}
