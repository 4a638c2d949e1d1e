//! Faults of options beyond their types.

use std::{
    fmt::{Debug, Display},
    ops::RangeBounds,
};

use crate::range::words;

/// Options of a stage, or a table of them; [`options`](crate::options) implements it.
pub trait Options {
    /// Returns the faults of the options beyond their types: every range that a value is outside of, in the order of
    /// the declarations, then what is wrong with several of them together.
    fn faults(&self) -> Vec<OptionFault> {
        Vec::new()
    }

    /// Checks the options beyond their types.
    ///
    /// # Errors
    ///
    /// Returns the first fault.
    fn check(&self) -> Result<(), OptionFault> {
        self.faults().into_iter().next().map_or(Ok(()), Err)
    }
}

/// A fault of one option.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` {problem}")]
pub struct OptionFault {
    /// Dotted key in the stage's table, e.g. `training.epochs`.
    pub key: String,
    /// Description of the fault, to be read after the key: `is 0, and must be from 1 to 100: …`.
    pub problem: String,
}

impl OptionFault {
    /// Returns the fault of the option of this key.
    pub fn new(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            problem: problem.into(),
        }
    }

    /// Returns the fault of the option in a table, e.g. `scene`.
    #[must_use]
    pub fn within(self, table: &str) -> Self {
        Self::new(format!("{table}.{}", self.key), self.problem)
    }
}

/// Checks options and collects their faults.
///
/// ```
/// let mut faults = options::OptionFaults::default();
/// faults.within("steps", 1, 2..=10_000, "a motion has a beginning and an end");
/// let bounds = options::above(0.0, 3600.0);
/// faults.within("duration_s", f64::NAN, bounds, "a grasp takes seconds");
/// let found = faults.found();
/// assert_eq!(found[0].key, "steps");
/// assert_eq!(
///     found[1].problem,
///     "is NaN, and must be more than 0 and at most 3600: a grasp takes seconds"
/// );
/// ```
#[derive(Debug, Clone, Default)]
pub struct OptionFaults {
    found: Vec<OptionFault>,
}

impl OptionFaults {
    /// Reports an option outside these bounds, and `why` the bounds are what they are. NaN is
    /// outside all bounds.
    pub fn within<N: PartialOrd + Copy + Debug + Display>(
        &mut self,
        key: &str,
        value: N,
        bounds: impl RangeBounds<N>,
        why: &str,
    ) {
        if !bounds.contains(&value) {
            let bounds = words(&bounds);
            self.note(key, format!("is {value:?}, and must be {bounds}: {why}"));
        }
    }

    /// Reports a fault of an option.
    pub fn note(&mut self, key: &str, problem: impl Into<String>) {
        self.found.push(OptionFault::new(key, problem));
    }

    /// Adds the faults of a table inside the stage's, e.g. `scene`.
    pub fn of_table(&mut self, table: &str, found: impl IntoIterator<Item = OptionFault>) {
        self.extend(found.into_iter().map(|fault| fault.within(table)));
    }

    /// Adds faults, by the keys that they have.
    pub fn extend(&mut self, found: impl IntoIterator<Item = OptionFault>) {
        self.found.extend(found);
    }

    /// Says whether no fault was reported so far.
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// Returns the faults reported so far.
    pub fn found(self) -> Vec<OptionFault> {
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::above;

    #[test]
    fn out_of_bounds_option_is_named_with_value_bounds_and_reason() {
        let mut faults = OptionFaults::default();
        faults.within("ok", 3, 1..=3, "");
        faults.within("fine", 1e-9, above(0.0, 1.0), "");
        assert_eq!(faults.clone().found(), []);
        faults.within("n", 4_000_000_000_u64, 1..=3, "each is held in memory");
        faults.within("share", f64::NAN, 0.0..=1.0, "it is a share");
        faults.within("part", 1.0, 0.0..1.0, "it is a share");
        let why = "nothing is faster";
        faults.within("rate_hz", f64::INFINITY, above(0.0, 10.0), why);
        faults.of_table("inner", [OptionFault::new("n", "is odd")]);
        let said: Vec<String> = faults.found().iter().map(ToString::to_string).collect();
        assert_eq!(
            said,
            [
                "`n` is 4000000000, and must be from 1 to 3: each is held in memory",
                "`share` is NaN, and must be from 0 to 1: it is a share",
                "`part` is 1.0, and must be from 0 to below 1: it is a share",
                "`rate_hz` is inf, and must be more than 0 and at most 10: nothing is faster",
                "`inner.n` is odd",
            ]
        );
    }
}
