//! Options of stages, from Python's dicts.

use std::{any::Any, path::PathBuf};

use pipeline::Refusal;
use pyo3::{prelude::*, types::PyDict};
use serde_json::{Map, Value};

use crate::error::{failed, wrong};

/// The options that name the files of a hand: the hand that is given says them.
const OF_HAND: [&str; 2] = ["hand", "hand_table"];

/// Returns the options of a stage in a pipeline file, for the argument `options`: all that decide what it makes, as a
/// dict, without the files that it reads.
///
/// `file` is the pipeline file and `stage` the stage's name in it, such as "screen"; `profile` is one of its profiles.
#[pyfunction]
#[pyo3(signature = (file, stage, *, profile=None))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "Python's paths become owned ones"
)]
pub(crate) fn options<'py>(
    py: Python<'py>,
    file: PathBuf,
    stage: &str,
    profile: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let found = py.detach(|| pipeline::options_in(&file, stage, profile));
    let json = found.map_err(|err| refused(&err))?.to_string();
    py.import("json")?.call_method1("loads", (json,))
}

/// Reads the options of a stage of a kind; `also` are those that the call itself says, and `hand` is the hand's file.
///
/// # Errors
///
/// Fails with an exception at the first option that the stage would refuse.
pub(crate) fn read<C: Any + Clone>(
    kind: &str,
    options: Option<&Bound<'_, PyDict>>,
    hand: Option<&PathBuf>,
    also: &[(&str, Value)],
) -> PyResult<C> {
    let mut values = options.map(json).transpose()?.unwrap_or_default();
    if hand.is_some() {
        values.retain(|key, _| !OF_HAND.contains(&key.as_str()));
    }
    let hand = hand.map(|hand| Value::from(hand.to_string_lossy()));
    values.extend(hand.map(|hand| (OF_HAND[0].to_owned(), hand)));
    values.extend(
        also.iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone())),
    );
    pipeline::stage_options(kind, &without_nulls(Value::Object(values)))
        .map_err(|err| refused(&err))
}

/// Returns the exception for what the program refuses.
pub(crate) fn refused(err: &Refusal) -> PyErr {
    failed(err, err.hint.clone())
}

/// Reads a dict as a JSON object.
pub(crate) fn json(options: &Bound<'_, PyDict>) -> PyResult<Map<String, Value>> {
    let py = options.py();
    let unusable = |problem: String| {
        wrong(
            format!("`options` cannot be used: {problem}"),
            "pass a dict of numbers, texts, lists and dicts, as a stage's table in a pipeline file",
        )
    };
    let strict = PyDict::new(py);
    strict.set_item("allow_nan", false)?;
    let text = py
        .import("json")?
        .call_method("dumps", (options,), Some(&strict));
    let text: String = text
        .map_err(|err| unusable(err.value(py).to_string()))?
        .extract()?;
    serde_json::from_str(&text).map_err(|err| unusable(err.to_string()))
}

/// Leaves out what is `null`: TOML has none, and an option that may be left out is left out.
fn without_nulls(value: Value) -> Value {
    match value {
        Value::Object(values) => {
            let left = values.into_iter().filter(|(_, value)| !value.is_null());
            Value::Object(
                left.map(|(key, value)| (key, without_nulls(value)))
                    .collect(),
            )
        }
        Value::Array(values) => values.into_iter().map(without_nulls).collect(),
        other => other,
    }
}
