//! Values given on the command line: `--set stage.key=value`, or several to sweep over.

use std::{fmt, ops::Range, str::FromStr};

use toml_edit::Value;

use crate::source::Location;

/// One value that overrides the pipeline file.
#[derive(Debug, Clone)]
pub struct Override {
    pub(crate) path: KeyPath,
    pub(crate) value: Value,
}

/// Text that is not an override.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OverrideError {
    /// No path of keys, or no value.
    #[error("`{0}` is not of the form `stage.key=value`")]
    Malformed(String),
    /// A list with an empty value.
    #[error("`{0}` has an empty value in its list")]
    EmptyValue(String),
}

impl FromStr for Override {
    type Err = OverrideError;

    /// Reads `stage.key=value`; a value that is not TOML is taken as text, so that paths need no
    /// quotes.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (path, value) = split(text)?;
        let value = parse_value(value).unwrap_or_else(|| Value::from(value));
        Ok(Self { path, value })
    }
}

impl Override {
    /// Returns it as it is written after `--set`, and where its value begins.
    pub(crate) fn argument(&self) -> (String, usize) {
        let keys = self.path.to_string();
        let value = match &self.value {
            // Only text that would parse as another type needs quotes.
            Value::String(text) if parse_value(text.value()).is_none() => text.value().clone(),
            other => other.to_string().trim().to_owned(),
        };
        (format!("{keys}={value}"), keys.len() + 1)
    }

    /// Returns the location of a part of it as it is written after `--set`: on the command line, or in the file
    /// that says it.
    pub(crate) fn place(&self, part: Range<usize>) -> Location {
        match &self.path.written {
            Some(key) => key.narrowed(&self.path.to_string(), part),
            None => Location::in_set(&self.argument().0, part),
        }
    }

    /// What gives the value, in words.
    pub(crate) fn giver(&self) -> &'static str {
        match self.path.written {
            Some(_) => "`[[sweep]]`",
            None => "`--set`",
        }
    }
}

impl fmt::Display for Override {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.path, self.value.to_string().trim())
    }
}

/// The target of a value.
#[derive(Debug, Clone)]
pub(crate) struct KeyPath {
    /// The stage, or `None` for a key at the top of the file, e.g. `seed`.
    pub(crate) stage: Option<String>,
    /// Path of keys inside the stage's table.
    pub(crate) keys: Vec<String>,
    /// Where a file says it; `None` on the command line.
    pub(crate) written: Option<Location>,
}

/// The same target, wherever it is written.
impl PartialEq for KeyPath {
    fn eq(&self, other: &Self) -> bool {
        (&self.stage, &self.keys) == (&other.stage, &other.keys)
    }
}

impl fmt::Display for KeyPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<&str> = self
            .stage
            .iter()
            .chain(&self.keys)
            .map(String::as_str)
            .collect();
        f.write_str(&words.join("."))
    }
}

/// Splits `stage.key=value` into path and value.
pub(crate) fn split(text: &str) -> Result<(KeyPath, &str), OverrideError> {
    let malformed = || OverrideError::Malformed(text.to_owned());
    let (path, value) = text.split_once('=').ok_or_else(malformed)?;
    let mut keys: Vec<String> = path.trim().split('.').map(str::to_owned).collect();
    if keys.iter().any(String::is_empty) {
        return Err(malformed());
    }
    let stage = (keys.len() > 1).then(|| keys.remove(0));
    let path = KeyPath {
        stage,
        keys,
        written: None,
    };
    Ok((path, value.trim()))
}

/// Reads a value of TOML.
pub(crate) fn parse_value(text: &str) -> Option<Value> {
    text.parse().ok()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_number_is_read_as_it_is_written(bits in any::<u64>(), few in 0..100_000_u32) {
            for number in [f64::from_bits(bits), f64::from(few) / 30_000.0] {
                if !number.is_finite() {
                    continue;
                }
                let given: Override = format!("a.b={number:?}").parse().unwrap();
                let again: Override = given.to_string().parse().unwrap();
                for read in [given, again] {
                    let read = read.value.as_float().unwrap();
                    prop_assert_eq!(read.to_bits(), number.to_bits());
                }
            }
        }
    }

    #[test]
    fn reads_numbers_and_unquoted_paths() {
        let number: Override = "train.kl_weight=1e-3".parse().unwrap();
        assert_eq!(number.path.stage.as_deref(), Some("train"));
        assert_eq!(number.value.as_float(), Some(1e-3));
        let path: Override = "ingest.root=/data/dexycb".parse().unwrap();
        assert_eq!(path.value.as_str(), Some("/data/dexycb"));
        let seed: Override = "seed=9".parse().unwrap();
        assert_eq!((seed.path.stage, seed.value.as_integer()), (None, Some(9)));
    }

    #[test]
    fn refuses_text_without_a_value() {
        assert!("train.kl_weight".parse::<Override>().is_err());
        assert!("train..x=1".parse::<Override>().is_err());
    }
}
