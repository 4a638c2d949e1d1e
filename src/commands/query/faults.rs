//! What is wrong with a question, in the project's words and with the near name.

use dataflow::nearest;
use polars::prelude::*;

use crate::outcome::Trouble;

/// How an error of the parser of SQL begins.
const PARSER: &str = "sql parser error: ";

/// A question for those who asked one that cannot be read.
const EXAMPLE: &str =
    "write it as, e.g., `select object, count(*) as n from rollouts group by object`";

/// Says what is wrong with a question; what it names is looked for among these tables.
pub(super) fn explain(err: &PolarsError, sql: &str, tables: &[(String, LazyFrame)]) -> Trouble {
    let text = message(err);
    if let Some(table) = between(&text, "relation '", "' was not found") {
        let names: Vec<&str> = tables.iter().map(|(name, _)| name.as_str()).collect();
        let list = format!("the tables are: {}", names.join(", "));
        return Trouble::usage(
            format!("no table `{table}`"),
            near(table, names.into_iter(), list),
        );
    }
    if let Some(column) = missing_column(&text) {
        let columns = columns(&text, sql, tables);
        let list = format!("the columns are: {}", columns.join(", "));
        return Trouble::usage(
            format!("no column `{column}`"),
            near(column, columns.iter().map(String::as_str), list),
        );
    }
    if let Some(text) = text.strip_prefix(PARSER) {
        return Trouble::usage(format!("cannot read the question: {text}"), EXAMPLE);
    }
    let message = format!("cannot answer the question: {text}");
    match innermost(err) {
        PolarsError::SQLSyntax(_) => Trouble::usage(message, EXAMPLE),
        PolarsError::SQLInterface(_) => Trouble::Usage {
            message,
            hint: None,
        },
        _ => Trouble::failed(anyhow::anyhow!(message), None),
    }
}

fn near<'a>(word: &str, names: impl Iterator<Item = &'a str>, list: String) -> String {
    match nearest(word, names) {
        Some(near) => format!("did you mean `{near}`? {list}"),
        None => list,
    }
}

/// The error below what polars says about where it was.
fn innermost(err: &PolarsError) -> &PolarsError {
    match err {
        PolarsError::Context { error, .. } | PolarsError::ExprContext { error, .. } => {
            innermost(error)
        }
        err => err,
    }
}

/// The first line of what the error says: the others show plans of the query.
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

/// The columns that the error lists as there, or else those of the tables that the question names.
fn columns(text: &str, sql: &str, tables: &[(String, LazyFrame)]) -> Vec<String> {
    if let Some(list) = between(text, "valid columns: [", "]") {
        let words = list.split(", ").map(|word| word.trim_matches('"'));
        return words.map(str::to_owned).collect();
    }
    let mut columns = Vec::new();
    for (name, frame) in tables {
        if !sql.contains(name.as_str()) {
            continue;
        }
        // A table that cannot be read has no columns to offer.
        if let Ok(schema) = frame.clone().collect_schema() {
            columns.extend(schema.iter_names().map(ToString::to_string));
        }
    }
    columns.sort();
    columns.dedup();
    columns
}
