//! Values given on the command line: `--set stage.key=value`.

use std::{fmt, str::FromStr};

use toml_edit::Value;

/// One value that replaces what the pipeline file says.
#[derive(Debug, Clone)]
pub struct Override {
    /// The stage, or `None` for a key at the top of the file, e.g. `seed`.
    pub(crate) stage: Option<String>,
    /// Path of keys inside the stage's table.
    pub(crate) keys: Vec<String>,
    pub(crate) value: Value,
}

/// Text that is no override.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not of the form `stage.key=value`")]
pub struct OverrideError(String);

impl FromStr for Override {
    type Err = OverrideError;

    /// Reads `stage.key=value`; a value that is no TOML is taken as text, so that paths need no
    /// quotes.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let malformed = || OverrideError(text.to_owned());
        let (path, value) = text.split_once('=').ok_or_else(malformed)?;
        let mut keys: Vec<String> = path.trim().split('.').map(str::to_owned).collect();
        if keys.iter().any(String::is_empty) {
            return Err(malformed());
        }
        let stage = (keys.len() > 1).then(|| keys.remove(0));
        let value = value.trim();
        Ok(Self {
            stage,
            keys,
            value: value.parse().unwrap_or_else(|_| Value::from(value)),
        })
    }
}

impl fmt::Display for Override {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(stage) = &self.stage {
            write!(f, "{stage}.")?;
        }
        write!(
            f,
            "{}={}",
            self.keys.join("."),
            self.value.to_string().trim()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_numbers_and_unquoted_paths() {
        let number: Override = "train.kl_weight=1e-3".parse().unwrap();
        assert_eq!(number.stage.as_deref(), Some("train"));
        assert_eq!(number.value.as_float(), Some(1e-3));
        let path: Override = "ingest.root=/data/dexycb".parse().unwrap();
        assert_eq!(path.value.as_str(), Some("/data/dexycb"));
        let seed: Override = "seed=9".parse().unwrap();
        assert_eq!((seed.stage, seed.value.as_integer()), (None, Some(9)));
    }

    #[test]
    fn refuses_text_without_a_value() {
        assert!("train.kl_weight".parse::<Override>().is_err());
        assert!("train..x=1".parse::<Override>().is_err());
    }
}
