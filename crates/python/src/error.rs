//! Failures as exceptions with what is wrong and what to do.

use std::path::Path;

use dataflow::with_causes;
use pyo3::{create_exception, exceptions::PyException, prelude::*};

create_exception!(
    pipeline,
    Error,
    PyException,
    "What is wrong, where, and what to do: the text, and the attribute `hint` (a text or `None`)."
);

/// Returns an exception with an error's causes and its hint.
pub(crate) fn failed(err: &dyn std::error::Error, hint: Option<String>) -> PyErr {
    raised(with_causes(err), hint)
}

/// Returns an exception with a text and a hint.
pub(crate) fn wrong(what: String, hint: &str) -> PyErr {
    raised(what, Some(hint.to_owned()))
}

/// Returns an exception with a text and perhaps a hint.
pub(crate) fn raised(what: String, hint: Option<String>) -> PyErr {
    let text = match &hint {
        Some(hint) => format!("{what}\nhint: {hint}"),
        None => what,
    };
    let err = Error::new_err(text);
    let told = Python::attach(|py| err.value(py).setattr("hint", hint));
    told.map_or_else(|other| other, |()| err)
}

/// Writes a file that the caller asked for.
///
/// # Errors
///
/// Fails with an exception if it cannot be written.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> PyResult<()> {
    lake::write_atomic(path, bytes).map_err(|err| {
        wrong(
            with_causes(&err),
            "pass the path of a file in a folder that can be written",
        )
    })
}
