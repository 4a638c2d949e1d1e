//! Differences as text.

use std::collections::BTreeMap;

use dataflow::{Change, StageName};
use serde_json::Value;

use super::{
    Difference,
    inputs::{InputChange, Source},
    outputs::{MetricChange, OutputChange},
    values::RequestDiff,
};
use crate::{
    numbers::number,
    report::{self, cut},
};

/// Maximum rows shown of a list.
const ROWS: usize = 20;

/// Maximum files named per folder and kind of change.
const FILES: usize = 4;

/// Maximum characters shown of a value.
const WIDTH: usize = 40;

/// Digits shown of a digest.
const DIGITS: usize = 12;

const ARROW: &str = "→";
const NONE: &str = "-";

/// All differences, in sections; equal values are left out.
pub(super) fn text(difference: &Difference) -> String {
    let mut text = String::new();
    section(&mut text, "values", request(&difference.diff), &[]);
    section(&mut text, "inputs", inputs(&difference.inputs), &[]);
    section(
        &mut text,
        "metrics",
        outputs(&difference.outputs),
        &[2, 4, 5],
    );
    for (number, outputs) in [
        (difference.old, &difference.only_old),
        (difference.new, &difference.only_new),
    ] {
        if !outputs.is_empty() {
            let lines = vec![vec![outputs.join(", ")]];
            section(
                &mut text,
                &format!("only run {number} went through"),
                lines,
                &[],
            );
        }
    }
    if text.is_empty() {
        text.push_str("no difference\n");
    }
    text
}

fn section(text: &mut String, title: &str, mut rows: Vec<Vec<String>>, right: &[usize]) {
    if rows.is_empty() {
        return;
    }
    let n_more = rows.len().saturating_sub(ROWS);
    rows.truncate(ROWS);
    text.push_str(title);
    text.push('\n');
    for line in report::columns(&rows, right).lines() {
        text.push_str(&format!("  {line}\n"));
    }
    if n_more > 0 {
        text.push_str(&format!("  … {n_more} more; `--format json` lists all\n"));
    }
}

fn row(key: &str, old: String, new: String) -> Vec<String> {
    vec![key.to_owned(), old, ARROW.to_owned(), new]
}

fn request(request: &RequestDiff) -> Vec<Vec<String>> {
    let alone = |stage: &StageName, what: &str| vec![stage.to_string(), what.to_owned()];
    let added = request.added_stages.iter();
    let mut rows: Vec<_> = added.map(|stage| alone(stage, "added")).collect();
    let removed = request.removed_stages.iter();
    rows.extend(removed.map(|stage| alone(stage, "removed")));
    for change in &request.rewired {
        let name = |node: &Option<String>| node.clone().unwrap_or_else(|| NONE.to_owned());
        rows.push(row(&change.key, name(&change.old), name(&change.new)));
    }
    let values = request.values.iter();
    rows.extend(values.map(|change| row(&change.key, value(&change.old), value(&change.new))));
    rows
}

fn value(value: &Value) -> String {
    let text = match value {
        Value::Null => NONE.to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    cut(&text, WIDTH)
}

/// One row per input; many files of one folder are counted.
fn inputs(changes: &[InputChange]) -> Vec<Vec<String>> {
    let mut folders: BTreeMap<(&str, String, String), usize> = BTreeMap::new();
    for change in changes {
        if let Some(folder) = folder(change) {
            *folders.entry(folder).or_default() += 1;
        }
    }
    folders.retain(|_, n| *n > FILES);
    let rows = changes.iter().filter_map(|change| match folder(change) {
        Some(folder) if folders.contains_key(&folder) => {
            // The first represents all of them.
            let n = folders.insert(folder.clone(), 0).filter(|n| *n > 0)?;
            let (path, what, outputs) = folder;
            Some(vec![format!("{n} files in {path}"), what, outputs])
        }
        _ => Some(input(change)),
    });
    rows.collect()
}

/// The folder of a file, the kind of change, and the file's readers.
fn folder(change: &InputChange) -> Option<(&str, String, String)> {
    let Source::File { name } = &change.source else {
        return None;
    };
    let (folder, _) = name.rsplit_once('/')?;
    Some((folder, change.change.to_string(), change.outputs.join(", ")))
}

fn input(change: &InputChange) -> Vec<String> {
    let (what, n_digits) = match &change.source {
        Source::File { name } => (format!("file {name}"), DIGITS),
        Source::Code { name } => (format!("code of {name}"), DIGITS),
        Source::LockedVersions => ("locked versions".to_owned(), DIGITS),
        Source::Schema { name } => (format!("schema of {name}"), WIDTH),
    };
    let version = |version: &Option<String>| {
        let version = version.as_deref().unwrap_or(NONE);
        version.chars().take(n_digits).collect::<String>()
    };
    let versions = match change.change {
        Change::Changed => format!("{} {ARROW} {}", version(&change.old), version(&change.new)),
        added_or_removed => added_or_removed.to_string(),
    };
    vec![what, versions, change.outputs.join(", ")]
}

fn outputs(outputs: &[OutputChange]) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    for output in outputs {
        let counts = [
            (&output.added, "added"),
            (&output.removed, "removed"),
            (&output.changed, "changed"),
        ];
        let counts = counts.into_iter().filter(|(list, _)| !list.is_empty());
        for (list, word) in counts {
            rows.push(vec![
                output.output.clone(),
                format!("partitions {word}"),
                list.len().to_string(),
            ]);
        }
        rows.extend(output.metrics.iter().map(|change| metric(output, change)));
    }
    rows
}

fn metric(output: &OutputChange, change: &MetricChange) -> Vec<String> {
    let shown = |value: Option<f64>| value.map_or_else(|| NONE.to_owned(), number);
    let mut row = vec![
        output.output.clone(),
        change.metric.clone(),
        shown(change.old),
        ARROW.to_owned(),
        shown(change.new),
    ];
    if let (Some(old), Some(new)) = (change.old, change.new) {
        let sign = if new > old { "+" } else { "" };
        row.push(format!("{sign}{}", number(new - old)));
    }
    row
}
