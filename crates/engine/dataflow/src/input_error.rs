//! The faults that any stage can find in its inputs.

use crate::advice::Diagnostic;

/// The faults that any stage can find in its inputs.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// An input has no partition, so that there is nothing to do.
    #[error("there are no {input} {to_do}")]
    Empty {
        /// The input, e.g. `candidates`.
        input: &'static str,
        /// What the stage does with them, e.g. `to refine`.
        to_do: &'static str,
    },
    /// A name, such as that of an option, is no partition of an input.
    #[error("there is no {item} `{name}` among the {input}")]
    Unknown {
        /// The input, e.g. `candidates`.
        input: &'static str,
        /// What it names, e.g. `object`.
        item: &'static str,
        /// The name.
        name: String,
        /// The names that there are.
        known: Vec<String>,
    },
}

impl InputError {
    /// Returns the error of a name that none of these items has.
    pub fn unknown<'a>(
        input: &'static str,
        item: &'static str,
        name: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        Self::Unknown {
            input,
            item,
            name: name.to_owned(),
            known: known.into_iter().map(str::to_owned).collect(),
        }
    }
}

impl Diagnostic for InputError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Empty { .. } => None,
            Self::Unknown { known, .. } => Some(format!("there are: {}", known.join(", "))),
        }
    }

    fn missing_input(&self) -> Option<&'static str> {
        match self {
            Self::Empty { input, .. } => Some(input),
            Self::Unknown { .. } => None,
        }
    }
}
