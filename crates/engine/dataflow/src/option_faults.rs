//! Faults of a stage's options beyond their types.

use std::{
    fmt::{Debug, Display},
    ops::RangeInclusive,
};

/// A fault of one option of a stage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionFault {
    /// Dotted key in the stage's table, e.g. `training.epochs`.
    pub key: String,
    /// Description of the fault, to be read after the key: `is 0, and must be from 1 to 100: …`.
    pub problem: String,
}

/// Checks a stage's options and collects their faults.
///
/// ```
/// let mut faults = dataflow::OptionFaults::default();
/// faults.within("steps", 1, 2..=10_000, "a motion has a beginning and an end");
/// faults.above("duration_s", f64::NAN, 0.0, 3600.0, "a grasp takes seconds");
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
        bounds: RangeInclusive<N>,
        why: &str,
    ) {
        if !bounds.contains(&value) {
            let (least, most) = bounds.into_inner();
            let problem = format!("is {value:?}, and must be from {least} to {most}: {why}");
            self.note(key, problem);
        }
    }

    /// Reports a number outside (`bound`, `most`], and `why`.
    pub fn above(&mut self, key: &str, value: f64, bound: f64, most: f64, why: &str) {
        if !(value > bound && value <= most) {
            let problem =
                format!("is {value:?}, and must be more than {bound} and at most {most}: {why}");
            self.note(key, problem);
        }
    }

    /// Reports a fault of an option.
    pub fn note(&mut self, key: &str, problem: impl Into<String>) {
        self.found.push(OptionFault {
            key: key.to_owned(),
            problem: problem.into(),
        });
    }

    /// Adds the faults of a table inside the stage's, e.g. `scene`: each a key in it and a
    /// description.
    pub fn of_table<F: Into<(&'static str, String)>>(&mut self, table: &str, found: Vec<F>) {
        for (key, problem) in found.into_iter().map(Into::into) {
            self.note(&format!("{table}.{key}"), problem);
        }
    }

    /// Returns the faults reported so far.
    pub fn found(self) -> Vec<OptionFault> {
        self.found
    }
}

/// A file or folder outside the lake that an option names, and that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileFault {
    /// Dotted key in the stage's table, e.g. `files.model`.
    pub key: String,
    /// Position in a list, from 0; `None` if the option is no list.
    pub element: Option<usize>,
    /// Description of the fault, to be read after the key: `names `model.bin`, which is no file here`.
    pub problem: String,
    /// Suggested fix.
    pub hint: Option<String>,
}

impl FileFault {
    /// The option or its element, as [`crate::pipeline`] remembers where it stands.
    pub(crate) fn place(&self) -> String {
        place_of(&self.key, self.element)
    }
}

/// Names an option, or an element of one that is a list.
pub(crate) fn place_of(key: &str, element: Option<usize>) -> String {
    element.map_or_else(|| key.to_owned(), |idx| format!("{key}[{idx}]"))
}

impl std::fmt::Display for FileFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}` {}", self.key, self.problem)
    }
}

impl std::fmt::Display for OptionFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}` {}", self.key, self.problem)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_bounds_option_is_named_with_value_bounds_and_reason() {
        let mut faults = OptionFaults::default();
        faults.within("ok", 3, 1..=3, "");
        faults.above("fine", 1e-9, 0.0, 1.0, "");
        assert_eq!(faults.clone().found(), []);
        faults.within("n", 4_000_000_000_u64, 1..=3, "each is held in memory");
        faults.within("share", f64::NAN, 0.0..=1.0, "it is a share");
        faults.above("rate_hz", f64::INFINITY, 0.0, 10.0, "nothing is faster");
        faults.of_table("inner", vec![("n", "is odd".to_owned())]);
        let said: Vec<String> = faults.found().iter().map(ToString::to_string).collect();
        assert_eq!(
            said,
            [
                "`n` is 4000000000, and must be from 1 to 3: each is held in memory",
                "`share` is NaN, and must be from 0 to 1: it is a share",
                "`rate_hz` is inf, and must be more than 0 and at most 10: nothing is faster",
                "`inner.n` is odd",
            ]
        );
    }
}
