//! Errors with a hint.

use std::{error::Error, fmt};

/// An error that can say what to do next.
pub trait Diagnostic: Error + Send + Sync + 'static {
    /// Returns the next action, if there is one: an edit or a command that can be pasted.
    fn hint(&self) -> Option<String> {
        None
    }

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

/// An error of any kind with its hint: that of a stage, into which `?` turns every [`Diagnostic`].
#[derive(Debug)]
pub struct BoxedDiagnostic(pub Box<dyn Diagnostic>);

impl BoxedDiagnostic {
    /// Returns an error that has no hint.
    pub fn without_hint(err: impl Error + Send + Sync + 'static) -> Self {
        Self(Box::new(WithoutHint(err)))
    }

    /// As [`Diagnostic::hint`].
    pub fn hint(&self) -> Option<String> {
        self.0.hint()
    }

    /// As [`Diagnostic::missing_input`].
    pub fn missing_input(&self) -> Option<&'static str> {
        self.0.missing_input()
    }

    /// Returns the error itself, if it is of this type.
    pub fn downcast_ref<E: Diagnostic>(&self) -> Option<&E> {
        let err: &dyn Error = &*self.0;
        err.downcast_ref()
    }
}

/// An error that has no hint.
#[derive(Debug)]
struct WithoutHint<E>(E);

impl<E: fmt::Display> fmt::Display for WithoutHint<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl<E: Error> Error for WithoutHint<E> {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

impl<E: Error + Send + Sync + 'static> Diagnostic for WithoutHint<E> {}

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
