//! Errors of a query, in the project's words and with near names.

use dataflow::nearest;
use lake::Lake;
use polars::prelude::*;

use super::source::Source;
use crate::outcome::CommandError;

/// Prefix of a SQL parser error.
const PARSER: &str = "sql parser error: ";

/// An example query, for the hint of one that cannot be parsed.
const EXAMPLE: &str =
    "write it as, e.g., `select object, count(*) as n from rollouts group by object`";

/// Returns the error of a query that cannot be parsed.
pub(super) fn unreadable(text: &str) -> CommandError {
    let text = text.strip_prefix(PARSER).unwrap_or(text);
    CommandError::usage(format!("cannot read the question: {text}"), EXAMPLE)
}

/// Returns the error of a failed query, given the tables that were opened for it.
pub(super) fn explain(
    err: &PolarsError,
    sql: &str,
    source: &mut Source,
    tables: &[(String, LazyFrame)],
) -> CommandError {
    let text = message(err);
    if let Some(table) = between(&text, "relation '", "' was not found") {
        // The message does not depend on the list of tables.
        let shown = source.shown();
        let mut names: Vec<&str> = shown.iter().map(String::as_str).collect();
        names.sort_unstable();
        let list = format!("the tables are: {}", names.join(", "));
        let hint = if Lake::history_tables().contains(&table) {
            format!("it is written when a run ends, and none has ended in this lake; {list}")
        } else {
            near(table, names.into_iter(), list)
        };
        return CommandError::usage(format!("no table `{table}`"), hint);
    }
    if let Some(column) = missing_column(&text) {
        let columns = columns(&text, tables);
        let list = format!("the columns are: {}", columns.join(", "));
        return CommandError::usage(
            format!("no column `{column}`"),
            near(column, columns.iter().map(String::as_str), list),
        );
    }
    if let Some(text) = text.strip_prefix(PARSER) {
        return unreadable(text);
    }
    let message = format!("cannot answer the question: {text}");
    if is_of_the_lake(innermost(err), sql) {
        let hint = "`pipeline verify` says what is damaged in the lake".to_owned();
        return CommandError::failed(anyhow::anyhow!(message), Some(hint));
    }
    CommandError::usage(message, EXAMPLE)
}

/// Whether the fault is an unreadable table of the lake, not the query.
fn is_of_the_lake(err: &PolarsError, sql: &str) -> bool {
    match err {
        // The user's own files are named in the query.
        PolarsError::IO { error, .. } => {
            let is_named = sql.to_lowercase().contains("read_parquet");
            error.kind() != std::io::ErrorKind::NotFound || !is_named
        }
        PolarsError::ComputeError(text) => text.to_lowercase().contains("parquet"),
        _ => false,
    }
}

fn near<'a>(word: &str, names: impl Iterator<Item = &'a str>, list: String) -> String {
    match nearest(word, names) {
        Some(near) => format!("did you mean `{near}`? {list}"),
        None => list,
    }
}

/// The innermost error, below polars's context.
fn innermost(err: &PolarsError) -> &PolarsError {
    match err {
        PolarsError::Context { error, .. } | PolarsError::ExprContext { error, .. } => {
            innermost(error)
        }
        err => err,
    }
}

/// The first line of the error: the others show query plans.
fn message(err: &PolarsError) -> String {
    let text = match innermost(err) {
        PolarsError::ColumnNotFound(text)
        | PolarsError::SchemaFieldNotFound(text)
        | PolarsError::SQLInterface(text)
        | PolarsError::SQLSyntax(text)
        | PolarsError::ComputeError(text)
        | PolarsError::InvalidOperation(text) => text.to_string(),
        other => other.to_string(),
    };
    text.lines().next().unwrap_or_default().to_owned()
}

fn missing_column(text: &str) -> Option<&str> {
    between(text, "unable to find column \"", "\"")
        .or_else(|| between(text, "no column named '", "'"))
        .or_else(|| between(text, "Column '", "' not found"))
        .or_else(|| between(text, "column '", "' not found"))
}

fn between<'t>(text: &'t str, start: &str, end: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(start)?;
    let (word, _) = rest.split_once(end)?;
    Some(word)
}

/// The known columns listed by the error, or else those of the query's tables.
fn columns(text: &str, tables: &[(String, LazyFrame)]) -> Vec<String> {
    if let Some(list) = between(text, "valid columns: [", "]") {
        let words = list.split(", ").map(|word| word.trim_matches('"'));
        return words.map(str::to_owned).collect();
    }
    let mut columns = Vec::new();
    for (_, frame) in tables {
        // An unreadable table has no columns to suggest.
        if let Ok(schema) = frame.clone().collect_schema() {
            columns.extend(schema.iter_names().map(ToString::to_string));
        }
    }
    columns.sort();
    columns.dedup();
    columns
}
