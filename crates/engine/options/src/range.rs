//! Ranges of options, in faults and in schemas.

use std::{
    fmt::Display,
    ops::{Bound, RangeBounds},
};

use schemars::Schema;
use serde::Serialize;

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
        (_, Bound::Unbounded) => String::new(),
    };
    least + &most
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
