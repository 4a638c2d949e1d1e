//! Errors with a hint.

use std::{error::Error, fmt};

/// An error that can say what to do next.
pub trait Diagnostic: Error + Send + Sync + 'static {
    /// The next action: an edit or a command that can be pasted.
    fn hint(&self) -> Option<String>;

    /// Returns the stage's input that has too few partitions, if that is the fault: the hint then
    /// adds the command that lists the skipped items of that input.
    fn missing_input(&self) -> Option<&'static str> {
        None
    }
}

/// Returns an error with its causes on one line; one that the text before it ends in is left out.
pub fn with_causes(err: &dyn Error) -> String {
    let mut text = err.to_string();
    let mut cause = err.source();
    while let Some(err) = cause {
        let words = err.to_string();
        if !text.ends_with(&words) {
            text = format!("{text}: {words}");
        }
        cause = err.source();
    }
    text
}

/// An error of any kind with its hint.
#[derive(Debug)]
pub struct BoxedDiagnostic(pub Box<dyn Diagnostic>);

impl<E: Diagnostic> From<E> for BoxedDiagnostic {
    fn from(err: E) -> Self {
        Self(Box::new(err))
    }
}

impl fmt::Display for BoxedDiagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Error for BoxedDiagnostic {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}
